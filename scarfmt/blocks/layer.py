"""LAYER block: entropy mode, channel table and context (layer 1 only), one row of the layer table (SPEC §7.11)."""

from __future__ import annotations

from typing import Any

import numpy as np

from scarfmt.blocks.declare import Check, Number, NumberRecord, Record, Repeat, Rule, When, build, read, stream_name
from scarfmt.blocks.spec import BlockSpec, Reading, Writing
from scarfmt.container.registries import BlockKind, Stream
from scarfmt.entropy.numbers import Spend
from scarfmt.errors import Malformed, Unsupported
from scarfmt.scene.model import (
    MAX_CHANNELS,
    MAX_CLASSES,
    MAX_COMPONENTS,
    MAX_DEPTHS,
    Channel,
    DecodedContext,
    LayerRow,
    Opening,
)
from scarfmt.scene.streams import CHANNEL_STREAMS

STATIC, NEURAL = 0, 1
"""Entropy modes: what codes INDICES, static tables or the index network (SPEC §10.4)."""

_CHANNEL = Record(
    "stream" / Number(shown=stream_name),
    Rule(
        Check("R-7.11-2", "stream is in the table of 6.4, of either profile", "bad-channel"),
        lambda at: at["stream"] in CHANNEL_STREAMS,
        lambda at: Malformed("bad-channel", f"no channel has stream {at['stream']}", field="channels"),
    ),
    "components" / Number(),
    Rule(
        Check("R-7.11-2", "components is 1..64", "bad-channel"),
        lambda at: 1 <= at["components"] <= MAX_COMPONENTS,
        lambda at: Malformed("bad-channel", f"a channel of {at['components']} components", field="channels"),
    ),
    "first_widths" / Number("xor f32", times="components") * "of a cell after one step",
)

_CLASS = Record("stages" / Number(), "steps" / Number(times="channel_count") * "one a channel")

LAYER = NumberRecord(
    "entropy_mode" / Number() * "what codes INDICES: 0 tables, 1 the index network (10.4)",
    Rule(
        Check("R-7.11-1", "entropy_mode is 0 or 1", "unsupported-entropy-mode"),
        lambda at: at["entropy_mode"] in (STATIC, NEURAL),
        lambda at: Unsupported(
            "unsupported-entropy-mode", f"entropy mode {at['entropy_mode']} needs a newer reader", field="entropy_mode"
        ),
    ),
    When(
        "layer == 1",
        "channel_count" / Number(limit=MAX_CHANNELS),
        "channels" / Repeat("channel_count", _CHANNEL),
        "passes_log2" / Number() * "10.2",
        "target_count" / Number(limit=MAX_DEPTHS),
        "occupancy_targets" / Number(times="target_count") * "10.2",
    ),
    "class_count" / Number(limit=MAX_CLASSES),
    "classes" / Repeat("class_count", _CLASS),
)
"""Parameters: `layer`, 1-based; after layer 1, `channel_count`."""


def pack_layer(row: LayerRow, opening: Opening | None) -> bytes:
    """The payload of a LAYER block; `opening` exactly in layer 1."""
    fields: dict[str, Any] = {"entropy_mode": NEURAL if row.neural else STATIC, "class_count": row.class_count}
    fields["classes"] = [
        {"stages": stages, "steps": np.array(steps, np.int64)}
        for stages, steps in zip(row.stages, row.steps, strict=True)
    ]
    if opening is None:
        return build(LAYER, fields, layer=0)
    channels, context = opening
    rows = [
        {"stream": c.stream, "components": c.components, "first_widths": np.array(c.first_width, np.float32)}
        for c in channels
    ]
    fields |= {"channel_count": len(channels), "channels": rows}
    fields |= {"passes_log2": context.passes_log2, "target_count": len(context.occupancies)}
    return build(LAYER, {**fields, "occupancy_targets": np.array(context.occupancies, np.int64)}, layer=1)


def unpack_layer(
    payload: bytes, layer: int, opening: Opening, spend: Spend = lambda count: True
) -> tuple[LayerRow, Opening]:
    """The row of a LAYER block, and what layer 1 says.

    Args:
        layer: 1-based; channels and context are read in layer 1.
        opening: what layer 1 said, for later layers.
        spend: takes adaptive numbers from what is allowed.

    Raises:
        Unsupported: ``unsupported-entropy-mode``.
        Malformed: ``bad-channel``, ``bad-number``, ``rans-length``, ``rans-last-word``, ``rans-seal``.
        LimitExceeded: ``count-limit``, ``limit-expansion``.
    """
    fields = read(LAYER, payload, f"layer {layer}", spend=spend, layer=layer, channel_count=len(opening[0]))
    if layer == 1:
        channels = tuple(
            Channel(Stream(row["stream"]), tuple(row["first_widths"].tolist())) for row in fields["channels"]
        )
        opening = channels, DecodedContext(fields["passes_log2"], tuple(fields["occupancy_targets"].tolist()))
    stages = tuple(row["stages"] for row in fields["classes"])
    steps = tuple(tuple(row["steps"].tolist()) for row in fields["classes"])
    return LayerRow(stages, steps, fields["entropy_mode"] == NEURAL), opening


def _take(writing: Writing) -> tuple[LayerRow, Opening | None]:
    model = writing.parts.model
    return model.layers[writing.layer - 1], (model.channels, model.context) if writing.layer == 1 else None


def _parameters(payload: bytes, reading: Reading) -> dict[str, Any]:
    return {"layer": reading.layer, "channel_count": len(reading.opening[0])}


SPEC = BlockSpec(
    kind=BlockKind.LAYER,
    section="7.11",
    declaration=LAYER,
    parse=lambda payload, reading: unpack_layer(payload, reading.layer, reading.opening, reading.spend),
    pack=lambda value: pack_layer(*value),
    taken=_take,
    count=lambda value: int(value[0].class_count),
    elements="classes in its row",
    layers=lambda model: range(1, len(model.layers) + 1),
    required=True,
    parameters=_parameters,
)

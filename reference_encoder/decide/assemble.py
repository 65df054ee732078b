"""From decisions to a :class:`QuantisedScene`: what both profiles share (encoder side)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from reference_encoder.decide.allocate import ChannelPlan, LatentChain, aligned_steps, plan_channel
from reference_encoder.decide.contexts import choose_rules
from reference_encoder.decide.lattice import Placement
from reference_encoder.decide.rdo import choose_values
from reference_encoder.latent.linear import Latent
from reference_encoder.latent.rvq import RvqResult
from scarfmt.codecs.channels import coarsen
from scarfmt.coding.tile import TileContent, first_values
from scarfmt.container.schema import Profile, Stream
from scarfmt.scene.codebooks import Codebooks
from scarfmt.scene.model import Channel, LayerRow, SceneModel

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

LATENT_STEP = 81.0
"""Coarsest cell of the latent channel, in codeword lattice units."""
BASE_SHARE = 0.265
"""Share of the bits that the first layer may take."""
_RATE_OFFSET_DB, _RATE_QUALITY, _RATE_SLOPE = 60.0, 42.0, 0.82


def codebook_size(anchors: int) -> int:
    """Codewords that pay for themselves: about one per 150 anchors, 16..1024."""
    return int(2 ** np.clip(np.round(np.log2(max(anchors, 1) / 150)), 4, 10))


def final_rate(quality: float, gaussians: int) -> float:
    """Lambda of the last layer: squared picture error per bit that is predicted to give `quality` dB.

    Measured on the real scenes (docs/decisions/0004-rate-constant.md).
    """
    return 10 ** (-(_RATE_OFFSET_DB + (quality - _RATE_QUALITY) / _RATE_SLOPE) / 10) / max(gaussians, 1)


def model_bits(rvq: RvqResult | None, latent: Latent | None) -> float:
    """About what codebooks and decoder cost."""
    if rvq is None or latent is None:
        return 0.0
    words = (len(rvq.coarse) + len(rvq.residual)) * int(rvq.coarse.shape[1])
    weights = sum(int(layer.weights.size) for layer in latent.decoder.layers)
    return 6.0 * words + 12.0 * weights


def latent_chain(
    latent: Latent | None, rvq: RvqResult | None, classes: I64, count: int, rate: float
) -> tuple[LatentChain, ChannelPlan, F64]:
    """What the latent can receive, the plan of its channel, and what the RVQ leaves for that channel."""
    if latent is None or rvq is None:
        none = np.zeros((count, 1))
        return LatentChain(0, none, none), ChannelPlan(Stream.LATENT, (1.0,), none, none), np.zeros((len(classes), 1))
    error = np.stack([np.bincount(classes, row, count) for row in rvq.distortion], axis=1)
    bits = np.concatenate([np.zeros((1, len(classes))), np.cumsum(rvq.bits, axis=0)])
    bits = np.stack([np.bincount(classes, row, count) for row in bits], axis=1)
    stages = len(rvq.bits)
    received = np.full(len(classes), stages)
    left = latent.values.astype(np.float64) - Codebooks(rvq.coarse, rvq.residual).latents(rvq.indices, received)
    weight = latent.weight[:, None].astype(np.float64)
    step = aligned_steps((LATENT_STEP,), weight, classes, count, rate) * left.shape[1]
    plan = plan_channel(Stream.LATENT, left, step, weight, classes, count)
    chain = LatentChain(
        stages,
        np.concatenate([bits, bits[:, -1:] + plan.bits[:, 1:]], axis=1),
        np.concatenate([error, plan.error[:, 1:]], axis=1),
    )
    return chain, plan, left


def position_bits(classes: I64, count: int) -> F64:
    """(classes,) bits of base positions and labels: about what the split coder spends on a dense surface."""
    return 10.0 * np.bincount(classes, minlength=count).astype(np.float64)


def cell_widths(step: Sequence[float], steps: I64) -> F64:
    """(n, components) widths of the cells after (n,) `steps` steps, 0 after none (SPEC §9.2)."""
    width = np.array(step) / 3.0 ** np.maximum(steps - 1, 0)[:, None]
    return np.asarray(np.where(steps[:, None] > 0, width, 0.0))


# SPEC §6.4 wants scales; with a colour channel, even an empty one, the decoder gives no degree 0 (SPEC §9.4).
_ALWAYS = (Stream.SCALE, Stream.COLOUR)


def build_model(
    profile: Profile,
    slots: int,
    plans: Sequence[ChannelPlan],
    rows: Sequence[LayerRow],
    values: Mapping[Stream, F64],
    weights: Mapping[Stream, F64],
    classes: I64,
    rate: float,
) -> tuple[SceneModel, dict[Stream, I64]]:
    """The model of `rows`, and the final integers of every channel that any class receives.

    Args:
        plans: channels in coding order.
        values, weights: (N, components) attribute values and sensitivities per channel.
        classes: (N,) final class numbers.
        rate: lambda of the last layer.
    """
    finals: dict[Stream, I64] = {}
    firsts: dict[Stream, I64] = {}
    used: list[int] = []
    for index, plan in enumerate(plans):
        steps = np.array([row[index] for row in rows[-1].steps])
        if not steps.any() and plan.stream not in _ALWAYS:
            continue
        used.append(index)
        unit = cell_widths(plan.step, np.maximum(steps, 1))[classes]
        final = choose_values(values[plan.stream] / unit, weights[plan.stream] * unit**2, classes, rate)
        final *= (steps > 0)[classes, None]
        finals[plan.stream] = final
        firsts[plan.stream] = coarsen(final, np.maximum(steps - 1, 0)[classes, None])
    streams = [plans[index].stream for index in used]
    rules = choose_rules(streams, [firsts[s] for s in streams], classes)
    channels = tuple(
        Channel(plans[index].stream, plans[index].step, rule) for index, rule in zip(used, rules, strict=True)
    )
    kept_rows = tuple(LayerRow(row.stages, tuple(tuple(s[i] for i in used) for s in row.steps)) for row in rows)
    return SceneModel(profile, slots, channels, kept_rows), finals


def anchor_order(model: SceneModel, placement: Placement, classes: I64) -> I64:
    """(N,) anchors as the contents of all tiles hold them, tile after tile (SPEC §6.3)."""
    appears = np.searchsorted([row.class_count for row in model.layers], classes, side="right")
    return np.lexsort((classes, placement.codes, appears, placement.tile))


def tile_contents(
    model: SceneModel,
    placement: Placement,
    classes: I64,
    finals: dict[Stream, I64],
    rvq: RvqResult | None,
    slot_layers: I64 | None = None,
) -> tuple[TileContent, ...]:
    """Tile contents in normative order (SPEC §6.3)."""
    order = anchor_order(model, placement, classes)
    edges = np.cumsum(np.bincount(placement.tile, minlength=len(placement.tiles)))[:-1]
    last, stages = len(model.layers), model.max_stages
    received = model.stages(last, classes)
    contents = []
    for here in np.split(order, edges):
        content = TileContent.empty(model, len(here))
        content.codes, content.classes = placement.codes[here], classes[here]
        content.values = [finals[channel.stream][here].astype(np.int32) for channel in model.channels]
        if rvq is not None and stages:
            chosen = rvq.indices[here, :stages]
            content.indices = np.where(np.arange(stages) < received[here, None], chosen, 0).astype(np.int16)
        if slot_layers is not None:
            content.slot_layers = slot_layers[here]
        content.first = first_values(model, content)
        contents.append(content)
    return tuple(contents)

"""PREDICTORS block: the context predictors first used in a layer (SPEC §10.3)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from scarfmt.blocks.declare import (
    Check,
    Derived,
    Number,
    NumberRecord,
    Record,
    Repeat,
    Rule,
    Scope,
    ShiftedNumbers,
    Use,
    When,
    build,
    read,
    stream_name,
)
from scarfmt.blocks.spec import BlockSpec
from scarfmt.container.registries import BlockKind, Stream
from scarfmt.entropy.numbers import Spend
from scarfmt.neural.arithmetic import MAX_WEIGHT, Linear
from scarfmt.neural.predictors import MAX_HIDDEN, MAX_INPUTS, Predictor, bad_predictor
from scarfmt.scene.model import MAX_CLASSES
from scarfmt.scene.streams import PREDICTED_STREAMS

MAX_PREDICTORS = 1024
"""Eleven components of attribute channels and 64 of LATENT, thirteen steps each, are 975."""

LAYER_OF_PREDICTOR = Record(
    "shift" / Number(limit=255),
    "weights" / Number("signed", times=f"rows * ((columns + classes) - {MAX_CLASSES})") * "row by row",
    # Here, as int32 would wrap a weight that the layer's own check must see.
    Rule(
        Check("R-10.3-2", "they are -32767..32767", "bad-predictor"),
        lambda at: int(np.abs(at["weights"]).max(initial=0)) <= MAX_WEIGHT,
        lambda at: bad_predictor(f"a weight above {MAX_WEIGHT}"),
    ),
    "biases" / ShiftedNumbers("rows"),
)
"""Parameters: `rows` and `columns`."""

_SOUND = Check("R-10.3-2", "the layers, step, B1 * B2", "bad-predictor")

_PREDICTOR = Record(
    "stream" / Number(limit=255, shown=stream_name),
    "component" / Number(limit=255),
    "step" / Number(limit=255),
    "b1" / Number(limit=255) * "B1 - 1",
    "b2" / Number(limit=255) * "B2 - 1",
    "classes" / Number(limit=255) * "class columns with weights, 0..15",
    "inputs" / Number(limit=255) * "N, 16..255",
    "units" / Number(limit=255) * "hidden units, 0..64",
    Rule(
        Check("R-10.3-1", "stream, classes, inputs, units", "bad-predictor"),
        lambda at: _sound_head(at),
        lambda at: bad_predictor("a record's head is out of range"),
    ),
    When("units > 0", "hidden" / Use("layer", LAYER_OF_PREDICTOR, rows="units", columns="inputs")),
    "output" / Use("layer", LAYER_OF_PREDICTOR, rows=2, columns="inputs + units"),
    "predictor" / Derived(lambda at: _make_predictor(at), checks=(_SOUND,)),
)

PREDICTORS = NumberRecord(
    "predictor_count" / Number(limit=MAX_PREDICTORS),
    Rule(
        Check("R-10.3-1", "predictor_count is at least 1", "bad-predictor"),
        lambda at: at["predictor_count"] > 0,
        lambda at: bad_predictor("the block holds no predictor"),
    ),
    "predictors" / Repeat("predictor_count", _PREDICTOR),
)


def _sound_head(at: Scope) -> bool:
    columns = at["classes"] <= MAX_CLASSES < at["inputs"] <= MAX_INPUTS
    return bool(at["stream"] in PREDICTED_STREAMS and columns and at["units"] <= MAX_HIDDEN)


def _make_predictor(at: Scope) -> Predictor:
    hidden = _linear(at["hidden"], at["classes"]) if at["units"] else None
    output, buckets = _linear(at["output"], at["classes"]), (at["b1"] + 1, at["b2"] + 1)
    predictor = Predictor(Stream(at["stream"]), at["component"], at["step"], hidden, output, buckets)
    predictor.check()
    return predictor


def _linear(at: Scope, classes: int) -> Linear:
    rows, columns = at["rows"], at["columns"]
    weights = np.zeros((rows, columns), np.int32)
    kept = at["weights"].reshape(rows, columns - MAX_CLASSES + classes)
    weights[:, :classes], weights[:, MAX_CLASSES:] = kept[:, :classes], kept[:, classes:]
    return Linear(weights, at["biases"], at["shift"])


def pack_predictors(predictors: Sequence[Predictor]) -> bytes:
    """The payload of a PREDICTORS block."""
    fields = {"predictor_count": len(predictors), "predictors": [_fields(predictor) for predictor in predictors]}
    return build(PREDICTORS, fields)


def _fields(predictor: Predictor) -> dict[str, Any]:
    layers = [layer for layer in (predictor.hidden, predictor.output) if layer is not None]
    # Columns of classes that no weight looks at are left out.
    used = np.concatenate([layer.weights[:, :MAX_CLASSES] for layer in layers]).any(axis=0)
    classes = int(np.flatnonzero(used).max(initial=-1)) + 1
    stream, component, step = predictor.key
    one, two = predictor.buckets
    fields: dict[str, Any] = {"stream": stream, "component": component, "step": step, "b1": one - 1, "b2": two - 1}
    fields |= {"classes": classes, "inputs": predictor.inputs, "units": predictor.units}
    if predictor.hidden is not None:
        fields["hidden"] = _layer_fields(predictor.hidden, classes)
    return {**fields, "output": _layer_fields(predictor.output, classes)}


def _layer_fields(layer: Linear, classes: int) -> dict[str, Any]:
    kept = np.delete(layer.weights, np.s_[classes:MAX_CLASSES], axis=1)
    return {"shift": layer.shift, "weights": kept.ravel(), "biases": layer.biases}


def unpack_predictors(payload: bytes, spend: Spend = lambda count: True) -> tuple[Predictor, ...]:
    """The predictors of a PREDICTORS block.

    Raises:
        Malformed: ``bad-predictor`` for none, or one that breaks SPEC §10.3 by itself; ``bad-number``, ``rans-length``,
            ``rans-last-word``, ``rans-seal``.
        LimitExceeded: ``count-limit``, ``limit-expansion``.
    """
    fields = read(PREDICTORS, payload, "predictors", spend=spend)
    return tuple(record["predictor"] for record in fields["predictors"])


SPEC = BlockSpec(
    kind=BlockKind.PREDICTORS,
    section="10.3",
    declaration=PREDICTORS,
    parse=lambda payload, reading: unpack_predictors(payload, reading.spend),
    pack=pack_predictors,
    taken=lambda writing: writing.parts.predictors.get(writing.layer) or None,
    count=len,
    elements="predictors",
)

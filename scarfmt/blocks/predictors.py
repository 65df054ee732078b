"""PREDICTORS block: the context predictors first used in a layer (SPEC §10.3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scarfmt.container.bytefields import ByteReader, unsigned_varint
from scarfmt.container.schema import Stream
from scarfmt.entropy.rice import pack_rice, pack_shifted, unpack_rice, unpack_shifted
from scarfmt.neural.arithmetic import MAX_WEIGHT, Linear
from scarfmt.neural.predictors import MAX_HIDDEN, Predictor, bad_predictor
from scarfmt.scene.model import MAX_CLASSES
from scarfmt.scene.streams import CONTEXT_STREAMS

MAX_PREDICTORS = 1024
"""Four attribute channels of ten components, twenty steps each, are 200."""
MAX_INPUTS = 255


def pack_predictors(predictors: Sequence[Predictor]) -> bytes:
    """The payload of a PREDICTORS block."""
    return unsigned_varint(len(predictors)) + b"".join(_pack(predictor) for predictor in predictors)


def _pack(predictor: Predictor) -> bytes:
    layers = _layers(predictor)
    # Columns of classes that no weight looks at are left out.
    used = np.concatenate([layer.weights[:, :MAX_CLASSES] for layer in layers]).any(axis=0)
    classes = int(np.flatnonzero(used).max(initial=-1)) + 1
    one, two = predictor.buckets
    head = bytes([*predictor.key, one - 1, two - 1, classes, predictor.inputs, predictor.units])
    return head + b"".join(_pack_layer(layer, classes) for layer in layers)


def _layers(predictor: Predictor) -> list[Linear]:
    return [layer for layer in (predictor.hidden, predictor.output) if layer is not None]


def _pack_layer(layer: Linear, classes: int) -> bytes:
    kept = np.delete(layer.weights, np.s_[classes:MAX_CLASSES], axis=1)
    return bytes([layer.shift]) + pack_rice(kept.ravel()) + pack_shifted(layer.biases)


def unpack_predictors(payload: bytes) -> tuple[Predictor, ...]:
    """The inverse of :func:`pack_predictors`.

    Raises:
        Malformed: ``bad-predictor`` for none, or one that breaks SPEC §10.3 by itself; ``bad-rice``.
        LimitExceeded: ``count-limit``.
    """
    reader = ByteReader(payload, "predictors")
    count = reader.count(MAX_PREDICTORS)
    if not count:
        raise bad_predictor("the block holds no predictor")
    predictors = tuple(_read(reader) for _ in range(count))
    reader.finish()
    return predictors


def _read(reader: ByteReader) -> Predictor:
    stream, component, step, one, two, classes, inputs, units = reader.take(8)
    sane = stream in CONTEXT_STREAMS and classes <= MAX_CLASSES < inputs <= MAX_INPUTS and units <= MAX_HIDDEN
    if not sane:
        raise bad_predictor("a record's head is out of range")
    hidden = _read_layer(reader, (units, inputs), classes) if units else None
    output = _read_layer(reader, (2, inputs + units), classes)
    predictor = Predictor(Stream(stream), component, step, hidden, output, (one + 1, two + 1))
    predictor.check()
    return predictor


def _read_layer(reader: ByteReader, shape: tuple[int, int], classes: int) -> Linear:
    shift = reader.take(1)[0]
    rows, columns = shape
    stored = columns - MAX_CLASSES + classes
    weights = np.zeros(shape, np.int32)
    kept = unpack_rice(reader, rows * stored).reshape(rows, stored)
    # Here, as int32 would wrap a weight that the layer's own check must see.
    if kept.size and int(np.abs(kept).max()) > MAX_WEIGHT:
        raise bad_predictor(f"a weight above {MAX_WEIGHT}")
    weights[:, :classes], weights[:, MAX_CLASSES:] = kept[:, :classes], kept[:, classes:]
    return Linear(weights, unpack_shifted(reader, rows), shift)

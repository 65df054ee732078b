"""PREDICTORS block: the context predictors first used in a layer (SPEC §10.3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scarfmt.bytefields import ByteReader, compress, decompress, signed_varint, unsigned_varint
from scarfmt.model import ATTRIBUTE_STREAMS, MAX_CLASSES
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.predictors import MAX_HIDDEN, Predictor, bad_predictor
from scarfmt.schema import Stream

MAX_PREDICTORS = 1024
"""Four attribute channels of ten components, twenty steps each, are 200."""
MAX_INPUTS = 255
MAX_PREDICTOR_BYTES = 4 << 20


def pack_predictors(predictors: Sequence[Predictor]) -> bytes:
    """The payload of a PREDICTORS block."""
    return compress(unsigned_varint(len(predictors)) + b"".join(_pack(predictor) for predictor in predictors))


def _pack(predictor: Predictor) -> bytes:
    layers = _layers(predictor)
    # Columns of classes that no weight looks at are left out.
    used = np.concatenate([layer.weights[:, :MAX_CLASSES] for layer in layers]).any(axis=0)
    classes = int(np.flatnonzero(used).max(initial=-1)) + 1
    one, two = predictor.buckets
    # int64: the magnitude of the least int32 does not fit int32.
    wide = any(int(np.abs(layer.weights.astype(np.int64)).max()) > 127 for layer in layers)
    head = bytes([*predictor.key, one - 1, two - 1, classes, predictor.inputs, predictor.units, 1 + wide])
    return head + b"".join(_pack_layer(layer, classes, wide) for layer in layers)


def _layers(predictor: Predictor) -> list[Linear]:
    return [layer for layer in (predictor.hidden, predictor.output) if layer is not None]


def _pack_layer(layer: Linear, classes: int, wide: bool) -> bytes:
    kept = np.delete(layer.weights, np.s_[classes:MAX_CLASSES], axis=1)
    biases = b"".join(signed_varint(int(bias)) for bias in layer.biases)
    return bytes([layer.shift]) + kept.astype("<i2" if wide else "<i1").tobytes() + biases


def unpack_predictors(payload: bytes) -> tuple[Predictor, ...]:
    """The inverse of :func:`pack_predictors`.

    Raises:
        Malformed: ``bad-predictor`` for one that breaks SPEC §10.3 by itself; ``bad-zstd``.
        LimitExceeded: ``content-limit``, ``count-limit``.
    """
    reader = ByteReader(decompress(payload, MAX_PREDICTOR_BYTES, "predictors"), "predictors")
    predictors = tuple(_read(reader) for _ in range(reader.count(MAX_PREDICTORS)))
    reader.finish()
    return predictors


def _read(reader: ByteReader) -> Predictor:
    stream, component, step, one, two, classes, inputs, units, width = reader.take(9)
    sane = stream in ATTRIBUTE_STREAMS and classes <= MAX_CLASSES < inputs <= MAX_INPUTS and units <= MAX_HIDDEN
    if not sane or width not in (1, 2):
        raise bad_predictor("a record's head is out of range")
    kind = "<i2" if width == 2 else "<i1"
    hidden = _read_layer(reader, (units, inputs), classes, kind) if units else None
    output = _read_layer(reader, (2, inputs + units), classes, kind)
    predictor = Predictor(Stream(stream), component, step, hidden, output, (one + 1, two + 1))
    predictor.check()
    return predictor


def _read_layer(reader: ByteReader, shape: tuple[int, int], classes: int, kind: str) -> Linear:
    shift = reader.take(1)[0]
    rows, columns = shape
    stored = columns - MAX_CLASSES + classes
    weights = np.zeros(shape, np.int32)
    kept = reader.array(kind, rows * stored).reshape(rows, stored)
    weights[:, :classes], weights[:, MAX_CLASSES:] = kept[:, :classes], kept[:, classes:]
    biases = np.array([reader.signed(32) for _ in range(rows)], np.int64)
    return Linear(weights, biases, shift)

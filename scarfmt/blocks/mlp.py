"""DECODER_MLP and SCENE_MLP blocks: small perceptrons with quantised weights (SPEC §7.9).

A network is a chain of layers y = W x + b with ReLU between layers and none after the last. Weights are
int16 times a per-row binary32 scale, biases binary32; the networks of a block are one zstd frame. What a
network computes is activated output: its tolerance is SPEC §9.5, not bit equality.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.container.bytefields import ByteReader, compress, decompress, unsigned_varint
from scarfmt.errors import Malformed

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I16 = NDArray[np.int16]

MAX_NETWORKS = 8
MAX_LAYERS = 4
MAX_WIDTH = 1024
MAX_MLP_BYTES = 16 << 20


@dataclass(frozen=True)
class Linear:
    """One layer.

    Attributes:
        weights: (out, in) int16.
        scales: (out,) float32, one a row.
        biases: (out,) float32.
    """

    weights: I16
    scales: F32
    biases: F32

    @classmethod
    def quantised(cls, weights: NDArray[np.floating], biases: NDArray[np.floating], bits: int = 8) -> Linear:
        """Round (out, in) `weights` to `bits` bits a value, each row on its own scale."""
        w = np.asarray(weights, np.float64)
        top = (1 << (bits - 1)) - 1
        scales = np.maximum(np.abs(w).max(axis=1, initial=0.0), 1e-30) / top
        scales = scales.astype(np.float32)
        integers = np.clip(np.rint(w / scales[:, None].astype(np.float64)), -top, top)
        return cls(integers.astype(np.int16), scales, np.asarray(biases, np.float32))

    @property
    def matrix(self) -> F64:
        """(out, in) float64 dequantised weights."""
        return self.weights.astype(np.float64) * self.scales[:, None].astype(np.float64)


@dataclass(frozen=True)
class QuantisedMlp:
    """A chain of layers, ReLU between them."""

    layers: tuple[Linear, ...]

    @property
    def inputs(self) -> int:
        """Input width."""
        return int(self.layers[0].weights.shape[1])

    @property
    def outputs(self) -> int:
        """Output width."""
        return int(self.layers[-1].weights.shape[0])

    def apply(self, x: NDArray[np.floating], dtype: type = np.float32) -> NDArray[np.floating]:
        """(n, outputs) of (n, inputs): computed in float64, the reference of SPEC §9.5, and rounded to `dtype`.

        A BLAS adds up rows in an order that depends on where they stand. In float64 that is far below what `dtype`
        float32 keeps: decoding a scene whole or tile by tile gives the same numbers.
        """
        y: NDArray[Any] = np.asarray(x, np.float64)
        for index, layer in enumerate(self.layers):
            y = (np.maximum(y, 0) if index else y) @ layer.matrix.T + layer.biases.astype(np.float64)
        return y.astype(dtype, copy=False)


def pack_networks(networks: tuple[QuantisedMlp, ...]) -> bytes:
    """The payload of a DECODER_MLP or SCENE_MLP block."""
    out = [unsigned_varint(len(networks))]
    for network in networks:
        out.append(unsigned_varint(len(network.layers)))
        for layer in network.layers:
            # int64: the magnitude of -32768 does not fit int16.
            wide = int(np.abs(layer.weights.astype(np.int64)).max(initial=0)) > 127
            out += [unsigned_varint(n) for n in layer.weights.shape] + [bytes([1 + wide])]
            out.append(layer.weights.astype("<i2" if wide else "<i1").tobytes())
            out += [layer.scales.astype("<f4").tobytes(), layer.biases.astype("<f4").tobytes()]
    return compress(b"".join(out))


def unpack_networks(payload: bytes, limit: int = MAX_MLP_BYTES) -> tuple[QuantisedMlp, ...]:
    """The inverse of :func:`pack_networks`.

    Raises:
        Malformed: ``bad-mlp`` for networks that break SPEC §7.9; ``bad-zstd``.
        LimitExceeded: ``content-limit``, ``count-limit``.
    """
    reader = ByteReader(decompress(payload, limit, "mlp"), "mlp")
    networks = tuple(_read_network(reader) for _ in range(reader.count(MAX_NETWORKS)))
    reader.finish()
    return networks


def _read_network(reader: ByteReader) -> QuantisedMlp:
    layers: list[Linear] = []
    for _ in range(reader.count(MAX_LAYERS)):
        rows, columns, width = reader.count(MAX_WIDTH), reader.count(MAX_WIDTH), reader.take(1)[0]
        if not rows or not columns or width not in (1, 2) or (layers and columns != layers[-1].weights.shape[0]):
            raise Malformed("bad-mlp", f"a layer of {rows} x {columns} does not fit (SPEC §7.9)", field="mlp")
        weights = reader.array("<i2" if width == 2 else "<i1", rows * columns).reshape(rows, columns)
        scales, biases = reader.array("<f4", rows), reader.array("<f4", rows)
        if not (np.isfinite(scales).all() and np.isfinite(biases).all()):
            raise Malformed("bad-mlp", "scales and biases must be finite (SPEC §7.9)", field="mlp")
        layers.append(Linear(weights.astype(np.int16), scales.astype(np.float32), biases.astype(np.float32)))
    if not layers:
        raise Malformed("bad-mlp", "a network needs a layer (SPEC §7.9)", field="mlp")
    return QuantisedMlp(tuple(layers))

"""DECODER_MLP and SCENE_MLP blocks: small perceptrons with quantised weights (SPEC §7.9).

A network is a chain of layers y = W x + b with ReLU between layers and none after the last. Weights are
int16 times a per-row binary32 scale, biases binary32. What a network computes is activated output: its tolerance is
SPEC §9.5, not bit equality.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, I16
from scarfmt.blocks.declare import Check, Number, NumberRecord, Record, Repeat, Rule, Scope, build, read
from scarfmt.blocks.spec import BlockSpec
from scarfmt.container.registries import BlockKind, Profile
from scarfmt.entropy.numbers import Spend
from scarfmt.errors import Malformed
from scarfmt.scene.model import first_layers

MAX_NETWORKS = 8
MAX_LAYERS = 4
MAX_WIDTH = 1024
_LEAST, _MOST = -(1 << 15), (1 << 15) - 1


_LAYER = Record(
    "rows" / Number(limit=MAX_WIDTH) * "outputs",
    Rule(
        Check("R-7.9-1", "rows is at least 1", "bad-mlp"),
        lambda at: at["rows"] > 0,
        lambda at: _bad("a layer without outputs"),
    ),
    "columns" / Number(limit=MAX_WIDTH) * "inputs",
    Rule(
        Check("R-7.9-1", "columns is at least 1, and equals rows of the layer before", "bad-mlp"),
        lambda at: _fits(at),
        lambda at: _bad(f"a layer of {at['columns']} inputs does not fit"),
    ),
    "weights" / Number("signed", times="rows * columns") * "row by row",
    Rule(
        Check("R-7.9-1", "they are -32768..32767", "bad-mlp"),
        lambda at: bool(((at["weights"] >= _LEAST) & (at["weights"] <= _MOST)).all()),
        lambda at: _bad("weights must fit 16 bits"),
    ),
    "scales" / Number("f32", times="rows"),
    Rule(
        Check("R-7.9-1", "they are finite", "bad-mlp"),
        lambda at: bool(np.isfinite(at["scales"]).all()),
        lambda at: _bad("scales must be finite"),
    ),
    "biases" / Number("f32", times="rows"),
    Rule(
        Check("R-7.9-1", "they are finite", "bad-mlp"),
        lambda at: bool(np.isfinite(at["biases"]).all()),
        lambda at: _bad("biases must be finite"),
    ),
)

_NETWORK = Record(
    "layer_count" / Number(limit=MAX_LAYERS),
    Rule(
        Check("R-7.9-1", "layer_count is at least 1", "bad-mlp"),
        lambda at: at["layer_count"] > 0,
        lambda at: _bad("a network needs a layer"),
    ),
    "layers" / Repeat("layer_count", _LAYER),
)

NETWORKS = NumberRecord("network_count" / Number(limit=MAX_NETWORKS), "networks" / Repeat("network_count", _NETWORK))
"""The numbers of a DECODER_MLP or SCENE_MLP block."""


def _fits(at: Scope) -> bool:
    chained = not at["earlier"] or at["columns"] == at["earlier"][-1]["rows"]
    return bool(at["columns"] and chained)


def _bad(message: str) -> Malformed:
    return Malformed("bad-mlp", f"{message} (SPEC §7.9)", field="mlp")


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
    def quantise(cls, weights: NDArray[np.floating], biases: NDArray[np.floating], bits: int = 8) -> Linear:
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
    fields = [
        {"layer_count": len(network.layers), "layers": [_layer_fields(layer) for layer in network.layers]}
        for network in networks
    ]
    return build(NETWORKS, {"network_count": len(networks), "networks": fields})


def _layer_fields(layer: Linear) -> dict[str, Any]:
    rows, columns = layer.weights.shape
    weights = layer.weights.ravel().astype(np.int64)
    return {"rows": rows, "columns": columns, "weights": weights, "scales": layer.scales, "biases": layer.biases}


def unpack_networks(payload: bytes, spend: Spend = lambda count: True) -> tuple[QuantisedMlp, ...]:
    """The networks of a DECODER_MLP or SCENE_MLP block.

    Raises:
        Malformed: ``bad-mlp`` for networks that break SPEC §7.9; ``bad-number``, ``rans-length``, ``rans-last-word``,
            ``rans-seal``.
        LimitExceeded: ``count-limit``, ``limit-expansion``.
    """
    networks = read(NETWORKS, payload, "mlp", spend=spend)["networks"]
    return tuple(QuantisedMlp(tuple(_linear(layer) for layer in network["layers"])) for network in networks)


def _linear(at: Scope) -> Linear:
    weights = at["weights"].reshape(at["rows"], at["columns"]).astype(np.int16)
    return Linear(weights, at["scales"], at["biases"])


DECODER_SPEC = BlockSpec(
    kind=BlockKind.DECODER_MLP,
    section="7.9",
    declaration=NETWORKS,
    parse=lambda payload, reading: unpack_networks(payload, reading.spend),
    pack=pack_networks,
    taken=lambda writing: None if writing.parts.decoder is None else (writing.parts.decoder,),
    count=len,
    elements="networks",
    layers=lambda model: {first_layers(model)[2]},
    required=True,
)

# Where the block is absent, the networks that are not there are refused (R-7.9-4).
SCENE_SPEC = BlockSpec(
    kind=BlockKind.SCENE_MLP,
    section="7.9",
    declaration=NETWORKS,
    parse=lambda payload, reading: unpack_networks(payload, reading.spend),
    pack=pack_networks,
    taken=lambda writing: writing.parts.scene_mlps or None,
    count=len,
    elements="networks",
    layers=lambda model: {1 if model.profile == Profile.ANCHOR else None},
)

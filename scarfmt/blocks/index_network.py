"""ENTROPY_NETWORK block: the index network (SPEC §10.5).

The header, then every array in the order of :class:`IndexNetwork`: matrices and start states Rice-coded, biases
too, after the zero bits that they all end in.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from scarfmt.arrays import I32, Ints
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
)
from scarfmt.blocks.spec import BlockSpec
from scarfmt.container.registries import BlockKind
from scarfmt.entropy.numbers import Spend
from scarfmt.errors import Malformed
from scarfmt.neural.arithmetic import MAX_WEIGHT, Linear
from scarfmt.neural.network import (
    MAX_CODEWORD_DIMS,
    MAX_GRU_LAYERS,
    MAX_HEADS,
    MAX_INPUTS,
    MAX_TOKENS,
    MAX_WIDTH,
    Attention,
    GruLayer,
    Head,
    IndexNetwork,
    Inputs,
)
from scarfmt.scene.model import MAX_CODEWORDS, first_neural_layer

_OWN, _ATTENTION = 1, 2

MATRIX = Record(
    "numbers" / Number("signed", times="rows * columns") * "row by row",
    # Here, as int32 would wrap a weight that the network's own check must see.
    Rule(
        Check("R-10.5-1", "they are -32767..32767", "bad-network"),
        lambda at: int(np.abs(at["numbers"]).max(initial=0)) <= MAX_WEIGHT,
        lambda at: Malformed("bad-network", f"a weight above {MAX_WEIGHT} (SPEC §10.1)", field="network"),
    ),
)
"""Parameters: `rows` and `columns`."""

LINEAR = Record(
    "shift" / Number(limit=255),
    "weights" / Use("matrix", MATRIX, rows="rows", columns="columns"),
    "biases" / ShiftedNumbers("rows"),
)
"""Parameters: `rows` and `columns`."""


def _linear(rows: Any, columns: Any) -> Use:
    return Use("linear", LINEAR, rows=rows, columns=columns)


# The first layer is fed a codeword, each of the others the state of the one before.
_GRU = Record(
    "shift" / Number(limit=255),
    When(
        "index == 0",
        "Wi" / Repeat("head_count", Use("matrix", MATRIX, rows="3 * hidden", columns="codeword_dims + 1")),
    ),
    When("index > 0", "Wi" / Repeat(1, Use("matrix", MATRIX, rows="3 * hidden", columns="hidden"))),
    "Wh" / Use("matrix", MATRIX, rows="3 * hidden", columns="hidden"),
    When("index == 0", "bi" / ShiftedNumbers("(tokens * 3) * hidden")),
    When("index > 0", "bi" / ShiftedNumbers("3 * hidden")),
    "bh" / ShiftedNumbers("3 * hidden"),
    "start" / ShiftedNumbers("hidden"),
)

_HEAD = Record(
    "size" / Number(limit=MAX_CODEWORDS),
    "project" / _linear("codeword_dims + 1", "mixed"),
    "shift" / Number(limit=255),
    "biases" / ShiftedNumbers("size"),
)

ENTROPY_NETWORK = NumberRecord(
    "activation_bits" / Number(limit=255) * "amax = 2^(activation_bits - 1) - 1",
    "flags" / Number(limit=255) * "bit 0: own; bit 1: attention",
    "latent_shift" / Number(limit=255),
    "codeword_shift" / Number(limit=255),
    "classes" / Number(limit=MAX_INPUTS) * "class columns",
    "attributes" / Number(limit=MAX_INPUTS) * "components of the attribute channels (10.2)",
    "depths" / Number(limit=MAX_INPUTS) * "how many occupancy targets there are",
    "latents" / Number(limit=MAX_INPUTS) * "latent dimensions that are looked at",
    "grid" / Number(limit=MAX_INPUTS) * "features of the hash grid",
    "codeword_dims" / Number(limit=MAX_CODEWORD_DIMS) * "dimensions of a codeword that are looked at",
    "embed_width" / Number(limit=MAX_WIDTH),
    "hidden" / Number(limit=MAX_WIDTH),
    "mixed" / Number(limit=MAX_WIDTH),
    "gru_count" / Number(limit=MAX_GRU_LAYERS) * "recurrent network layers",
    "tokens" / Number(limit=MAX_TOKENS) * "stages that a recurrent layer has biases for",
    "head_count" / Number(limit=MAX_HEADS),
    Rule(
        Check("R-10.5-1", "all other flags are 0", "bad-network"),
        lambda at: not at["flags"] & ~(_OWN | _ATTENTION),
        lambda at: _bad(f"reserved flags in {at['flags']:#x}"),
    ),
    "N"
    / Derived(
        lambda at: _inputs(at).width, "classes + (attributes if own) + depths * (attributes + latents + 1) + grid"
    ),
    # Here, as the product of attributes and depths is not bounded by their limits.
    Rule(
        Check("R-10.5-1", "N is at most 512", "bad-network"),
        lambda at: at["N"] <= MAX_INPUTS,
        lambda at: _bad(f"{at['N']} input columns, at most {MAX_INPUTS}"),
    ),
    "embed1" / _linear("embed_width", "N"),
    "embed2" / _linear("hidden", "embed_width"),
    "gru" / Repeat("gru_count", _GRU),
    When(
        f"flags & {_ATTENTION}",
        "query" / _linear("hidden", "hidden"),
        "key" / _linear("hidden", "hidden"),
        "value" / _linear("hidden", "hidden"),
        "score_shift" / Number(limit=255),
    ),
    "mixer" / _linear("mixed", "2 * hidden"),
    "heads" / Repeat("head_count", _HEAD),
)


def _bad(message: str) -> Malformed:
    return Malformed("bad-network", f"{message} (SPEC §10.5)", field="network")


def pack_network(network: IndexNetwork) -> bytes:
    """The payload of an ENTROPY_NETWORK block, of a network that passes :meth:`IndexNetwork.check`."""
    attention, inputs, first = network.attention, network.inputs, network.gru[0]
    fields: dict[str, Any] = {
        "activation_bits": network.activation_bits,
        "flags": _OWN * inputs.own | _ATTENTION * (attention is not None),
        "latent_shift": inputs.latent_shift,
        "codeword_shift": network.codeword_shift,
        **{name: getattr(inputs, name) for name in ("classes", "attributes", "depths", "latents", "grid")},
        "codeword_dims": network.codeword_dims,
        "embed_width": network.embed[0].outputs,
        "hidden": network.hidden,
        "mixed": network.mixer.outputs,
        "gru_count": len(network.gru),
        "tokens": len(first.biases),
        "head_count": len(network.heads),
        "embed1": _linear_fields(network.embed[0]),
        "embed2": _linear_fields(network.embed[1]),
        "gru": [_gru_fields(layer) for layer in network.gru],
        "mixer": _linear_fields(network.mixer),
        "heads": [_head_fields(head) for head in network.heads],
    }
    if attention is not None:
        fields |= {name: _linear_fields(getattr(attention, name)) for name in ("query", "key", "value")}
        fields["score_shift"] = attention.shift
    return build(ENTROPY_NETWORK, fields)


def _matrix_fields(matrix: Ints) -> dict[str, Any]:
    return {"numbers": matrix.ravel()}


def _linear_fields(layer: Linear) -> dict[str, Any]:
    return {"shift": layer.shift, "weights": _matrix_fields(layer.weights), "biases": layer.biases}


def _gru_fields(layer: GruLayer) -> dict[str, Any]:
    return {
        "shift": layer.shift,
        "Wi": [_matrix_fields(matrix) for matrix in layer.inputs],
        "Wh": _matrix_fields(layer.recurrent),
        "bi": layer.biases,
        "bh": layer.recurrent_biases,
        "start": layer.start,
    }


def _head_fields(head: Head) -> dict[str, Any]:
    return {
        "size": len(head.biases),
        "project": _linear_fields(head.project),
        "shift": head.shift,
        "biases": head.biases,
    }


def unpack_network(payload: bytes, spend: Spend = lambda count: True) -> IndexNetwork:
    """The index network; what depends on the codebooks is left to :meth:`IndexNetwork.check`.

    Raises:
        Malformed: ``bad-network`` for a network that breaks SPEC §10.5; ``bad-number``, ``rans-length``,
            ``rans-last-word``, ``rans-seal``.
        LimitExceeded: ``count-limit``, ``limit-expansion``.
    """
    at = read(ENTROPY_NETWORK, payload, "network", spend=spend)
    network = IndexNetwork(
        activation_bits=at["activation_bits"],
        inputs=_inputs(at),
        codeword_dims=at["codeword_dims"],
        codeword_shift=at["codeword_shift"],
        embed=(_layer(at["embed1"]), _layer(at["embed2"])),
        gru=tuple(_gru(layer, 1 if number else at["tokens"]) for number, layer in enumerate(at["gru"])),
        attention=_attention(at) if at["flags"] & _ATTENTION else None,
        mixer=_layer(at["mixer"]),
        heads=tuple(Head(_layer(head["project"]), head["biases"], head["shift"]) for head in at["heads"]),
    )
    network.check_structure()
    return network


def _inputs(at: Mapping[str, Any]) -> Inputs:
    own = bool(at["flags"] & _OWN)
    blocks = at["attributes"], at["depths"], at["latents"]
    return Inputs(at["classes"], own, *blocks, at["latent_shift"], at["grid"])


def _matrix(at: Scope) -> I32:
    return np.asarray(at["numbers"].reshape(at["rows"], at["columns"]).astype(np.int32))


def _layer(at: Scope) -> Linear:
    return Linear(_matrix(at["weights"]), at["biases"], at["shift"])


def _gru(at: Scope, tokens: int) -> GruLayer:
    rows = 3 * at["hidden"]
    biases = at["bi"].reshape(tokens, rows)
    matrices = tuple(_matrix(matrix) for matrix in at["Wi"])
    return GruLayer(matrices, _matrix(at["Wh"]), biases, at["bh"], at["start"], at["shift"])


def _attention(at: Scope) -> Attention:
    return Attention(_layer(at["query"]), _layer(at["key"]), _layer(at["value"]), at["score_shift"])


SPEC = BlockSpec(
    kind=BlockKind.ENTROPY_NETWORK,
    section="10.5",
    declaration=ENTROPY_NETWORK,
    parse=lambda payload, reading: unpack_network(payload, reading.spend),
    pack=pack_network,
    taken=lambda writing: writing.parts.network,
    count=lambda network: 1,
    elements="1",
    layers=lambda model: {first_neural_layer(model)},
    required=True,
)

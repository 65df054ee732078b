"""Invalid vectors of ENTROPY_NETWORK blocks (SPEC §10.5): limits, ends, widths, reaches, and where a block stands."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from conformance.scenes.cases import Fault
from conformance.surgery.edit import Changes, edit, further, renumber
from conformance.surgery.files import block_of, blocks_of, change_block, change_numbers, copy_block, rebuilt, without
from conformance.writer.numbers import Number
from scarfmt.blocks.index_network import pack_network, unpack_network
from scarfmt.container.schema import BlockKind
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.network import GruLayer, IndexNetwork
from scarfmt.scene.model import MAX_CLASSES

_HEADER, _RANGE, _RECURRENT, _TOKENS, _HEADS, _FIT, _LOGITS, _ROWS = (
    (rule, "bad-network") for rule in (*(f"R-10.5-{number}" for number in range(1, 8)), "R-10.1-1")
)
_LIMIT = "R-8.5-4", "count-limit"
_NETWORK = BlockKind.ENTROPY_NETWORK


def _network_of(data: bytes) -> IndexNetwork:
    return unpack_network(block_of(data, _NETWORK).payload)


def _edit(data: bytes, changes: Changes) -> bytes:
    """The file with fields of its index network changed."""
    return change_block(data, _NETWORK, 1, lambda payload: pack_network(edit(unpack_network(payload), changes)))


def network_faults(deep: bytes, plain: bytes, equal: bytes, edge: bytes) -> Iterator[Fault]:
    """Faults of networks with attention, without, as wide as the latent, at the edge of what is allowed."""
    for data, rows in ((deep, _deep_rows(_network_of(deep))), (plain, _plain_rows()), (equal, _equal_rows(equal)),
                       (edge, _EDGE_ROWS)):
        for name, purpose, rule, changes in rows:
            yield name, purpose, *rule, _edit(data, changes)
    yield ("network-no-recurrence", "no recurrent layer, nor tokens", *_RANGE,
           change_numbers(plain, _NETWORK, _without_recurrence))
    yield from _number_faults(deep, plain)


Row = tuple[str, str, tuple[str, str], Changes]
"""Name, what is wrong, rule and refusal id, changes of the network."""


def _deep_rows(network: IndexNetwork) -> Iterator[Row]:
    for name, path in (
        ("latent", "inputs.latent_shift"), ("recurrent", "gru.1.shift"), ("score", "attention.shift"),
        ("logit", "heads.0.shift"),
    ):
        yield f"network-{name}-shift", f"the {name} shift is 25", _RANGE, {path: 25}
    yield "network-linear-shift", "the shift of a linear layer is 25", _ROWS, {"mixer.shift": 25}
    for name, path, sign in (
        ("embed1", "embed.0", 1), ("embed2", "embed.1", -1), ("query", "attention.query", 1),
        ("key", "attention.key", -1), ("value", "attention.value", 1), ("project", "heads.0.project", -1),
    ):
        yield f"{name}-reach", f"a bias of {name} reaches 2^24", _ROWS, {f"{path}.biases.-1": sign << 24}
    yield ("recurrent-upper-reach", "a bias of the second recurrent layer reaches 2^23", _RECURRENT,
           {"gru.1.biases": lambda biases: biases + (1 << 23)})
    # A check in too narrow a type fails to see them.
    for name, what, value in (("highest", "2^31 - 1", (1 << 31) - 1), ("wraps", "2^16 + 1", (1 << 16) + 1)):
        yield f"mixer-weight-{name}", f"a weight of {what}", _HEADER, {"mixer.weights.0.0": value}
    for name, value in (("highest", (1 << 31) - 1), ("lowest", 1 - (1 << 31))):
        yield f"mixer-bias-{name}", f"a bias of {value}", _ROWS, {"mixer.biases.0": value}
    yield "start-too-low", "a start state below the activations", _RANGE, {"gru.0.start.0": -network.amax - 1}
    yield "start-too-large", "a start state beyond the activations", _RANGE, {"gru.0.start.0": network.amax + 1}
    yield ("network-sixteen-classes", "columns for a sixteenth class", _RANGE,
           {"embed.0.weights": lambda weights: _class_columns(weights, network.inputs.classes),
            "inputs.classes": MAX_CLASSES + 1})
    yield "head-empty", "a head for no codewords", _HEADS, {"heads.0.biases": lambda biases: biases[:0]}
    yield ("head-too-small", "a head for a codeword less than its codebook has", _FIT,
           {"heads.0.biases": lambda biases: biases[:-1]})
    yield ("head-too-large", "a head for one codeword more than its codebook has", _FIT,
           {"heads.0.biases": _zero_more})
    yield ("network-few-tokens", "no biases for the fourth of eight stages", _FIT,
           {"gru.0.biases": lambda biases: biases[:2]})
    yield ("tokens-without-head", "biases for later stages, but one head", _TOKENS,
           {"gru.0.inputs": _first, "heads": _first})
    # One attribute less, a latent and a class more: as wide, so that only A itself is wrong.
    yield ("network-attributes", "as many input columns, but for five attribute components of six", _FIT,
           {"inputs.attributes": 5, "inputs.latents": 4, "inputs.classes": network.inputs.classes + 1})


def _plain_rows() -> Iterator[Row]:
    """Widths of 0, arrays to match; and others."""
    projections = "heads.0.project", "heads.1.project"
    yield ("network-no-input", "no input columns", _RANGE,
           {"inputs.classes": 0, "inputs.own": False, "embed.0.weights": _columns(0)})
    yield ("network-no-codeword-dims", "no codeword dimensions", _RANGE,
           {"codeword_dims": 0, "gru.0.inputs": lambda parts: tuple(part[:, :1] for part in parts),
            **dict.fromkeys(projections, _rows(1))})
    yield ("network-no-embedding", "an embedding of no width", _RANGE,
           {"embed.0": _rows(0), "embed.1.weights": _columns(0)})
    yield ("network-no-state", "a state of no width", _RANGE,
           {"embed.1": _rows(0), "gru.0": _without_state, "mixer.weights": _columns(0)})
    yield ("network-no-mixer", "a mixer of no width", _RANGE,
           {"mixer": _rows(0), **{f"{path}.weights": _columns(0) for path in projections}})
    yield ("network-no-head", "no head", _RANGE,
           {"gru.0.inputs": (), "gru.0.biases": lambda biases: biases[:0], "heads": ()})
    yield ("network-7-bits-alone", "7 activation bits, start states of 0", _RANGE,
           {"activation_bits": 7, "gru.0.start": lambda start: 0 * start})
    yield ("weight-low-alone", "a weight of -32768 among zeros", _HEADER,
           {"mixer": lambda layer: _alone(layer, 0 * layer.weights, 0)})
    yield ("head-missing", "codebook 1, but one head and no tokens", _FIT,
           {"gru.0.inputs": _first, "gru.0.biases": lambda biases: biases[:0], "heads": _first})
    # Without depths the columns stay as many.
    yield "network-latents", "more latent means than the latent has dimensions", _FIT, {"inputs.latents": 5}


def _equal_rows(equal: bytes) -> Iterator[Row]:
    inputs = _network_of(equal).inputs
    column = (0, 0), (0, 1)
    yield ("network-codeword-dims", "more codeword dimensions than the latent has", _FIT,
           {"codeword_dims": 3, "gru.0.inputs": lambda parts: tuple(np.pad(part, column) for part in parts),
            "heads": lambda heads: tuple(edit(head, {"project": _row_more}) for head in heads)})
    more = replace(inputs, depths=2).width - inputs.width
    yield ("network-depths", "columns for two depths, the file has one", _FIT,
           {"inputs.depths": 2, "embed.0.weights": lambda weights: np.pad(weights, ((0, 0), (0, more)))})
    yield ("weight-lowest", "a weight of -32768 in a row that stays in reach", _ROWS,
           {"mixer": lambda layer: _alone(layer, layer.weights.copy(), 24)})


_EDGE_ROWS: tuple[Row, ...] = (
    ("mixer-reach", "an accumulator that can reach 2^24", _ROWS, {"mixer.biases.-1": further}),
    ("recurrent-reach", "an accumulator of a recurrent layer that can reach 2^23", _RECURRENT,
     {"gru.0.recurrent_biases.3": further}),
    ("token-reach", "the bias of a later stage reaches 2^23 with the worse matrix", _RECURRENT,
     {"gru.0.biases.1.5": further}),
    ("logit-reach", "a logit's accumulator that can reach 2^24", _LOGITS, {"heads.0.biases.7": further}),
    ("logit-reach-second", "that of the second head", _LOGITS, {"heads.1.biases.4": further}),
)
"""One bias of a network at the edge is one further from 0."""


def _rows(count: int) -> Callable[[Linear], Linear]:
    return lambda layer: Linear(layer.weights[:count], layer.biases[:count], layer.shift)


def _columns(count: int) -> Callable[[np.ndarray], np.ndarray]:
    return lambda weights: weights[:, :count]


def _first(items: tuple[object, ...]) -> tuple[object, ...]:
    return items[:1]


def _zero_more(biases: np.ndarray) -> np.ndarray:
    return np.append(biases, 0)


def _row_more(layer: Linear) -> Linear:
    return Linear(np.pad(layer.weights, ((0, 1), (0, 0))), _zero_more(layer.biases), layer.shift)


def _class_columns(weights: np.ndarray, classes: int) -> np.ndarray:
    """Columns of zeros for the classes after the network's own, up to class 15."""
    return np.insert(weights, [classes] * (MAX_CLASSES + 1 - classes), 0, axis=1)


def _without_state(gru: GruLayer) -> GruLayer:
    return GruLayer(tuple(part[:0] for part in gru.inputs), np.zeros((0, 0), np.int32), gru.biases[:, :0],
                    gru.recurrent_biases[:0], gru.start[:0], gru.shift)


def _without_recurrence(numbers: list[Number]) -> list[Number]:
    """The numbers without those of the one recurrent layer: the third part of four that begin with a shift."""
    _, _, start, past, *_ = (i for i, (field, _) in enumerate(numbers) if field[0] == "shift")
    return renumber(("gru_count", 0), ("tokens", 0))([*numbers[:start], *numbers[past:]])


def _alone(layer: Linear, weights: np.ndarray, shift: int) -> Linear:
    """The layer with these weights, but -32768 and zeros in row 0, and no biases."""
    weights[0] = 0
    weights[0, 0] = -32768
    return Linear(weights, 0 * layer.biases, shift)


_COUNTS = {
    "classes": 512, "attributes": 512, "depths": 512, "latents": 512, "grid": 512, "codeword_dims": 64,
    "embed_width": 256, "hidden": 256, "mixed": 256, "gru_count": 4, "tokens": 7, "head_count": 2,
}
"""The counts of a network in their order, and the limit of each."""
_BYTES = "activation_bits", "flags", "latent_shift", "codeword_shift", "shift", "score_shift"


def _number_faults(deep: bytes, plain: bytes) -> Iterator[Fault]:
    """Numbers of a network with attention, and of one of two class columns and six own values.

    Counts above their limits are refused before anything that follows them is looked at.
    """
    for name, purpose, rule, data, field, value in (
        ("network-flag", "a flag that is not assigned", _HEADER, deep, "flags", 7),
        ("network-wide-inputs", "more than 512 input columns", _HEADER, deep, "grid", 500),
        ("network-13-bits", "13 activation bits", _RANGE, deep, "activation_bits", 13),
        ("network-codeword-shift", "a shift of 25", _RANGE, deep, "codeword_shift", 25),
        ("network-7-bits", "7 activation bits", _RANGE, plain, "activation_bits", 7),
        ("network-513-inputs", "513 input columns", _HEADER, plain, "grid", 505),
        *((f"network-many-{field.replace('_', '-')}", f"{field} is {limit + 1}", _LIMIT, plain, field, limit + 1)
          for field, limit in _COUNTS.items()),
        *((f"network-{field.replace('_', '-')}-256", f"{field} is 256", _LIMIT, deep, field, 256) for field in _BYTES),
        ("head-4097", "a head for 4097 codewords", _LIMIT, plain, "size", 4097),
    ):
        yield name, purpose, *rule, change_numbers(data, _NETWORK, renumber((field, value)))


def place_faults(static: bytes, plain: bytes, grid: bytes, small: bytes, modes: bytes) -> Iterator[Fault]:
    """Networks and grids where none may stand, or missing.

    Args:
        static: a file without a network.
        plain: one whose network has no grid inputs.
        grid, small: two whose network has them.
        modes: one whose first layer has entropy mode 0.
    """
    kind, rules = BlockKind.HASH_GRID, ("R-10.4-2", "R-10.4-3")
    unexpected = "unexpected-block"
    yield "no-network", "entropy mode 1 without ENTROPY_NETWORK", rules[0], "missing-block", without(plain, _NETWORK, 1)
    yield ("idle-network", "a second ENTROPY_NETWORK, in the second layer of mode 1", rules[0], unexpected,
           copy_block(plain, _NETWORK, 2))
    yield "idle-grid", "a second HASH_GRID", rules[1], unexpected, copy_block(grid, kind, 2)
    yield "no-grid", "the network has grid inputs, the file no HASH_GRID", *_FIT, without(grid, kind, 1)
    network, block = block_of(modes, _NETWORK), block_of(small, kind)
    yield ("grid-not-read", "the file has a HASH_GRID, the network no grid inputs", *_FIT,
           rebuilt(plain, [*blocks_of(plain), block_of(grid, kind)]))
    yield ("grid-without-mode", "HASH_GRID in a file without entropy mode 1", rules[1], unexpected,
           rebuilt(static, [*blocks_of(static), block]))
    yield ("grid-early", "HASH_GRID in a layer before the first of entropy mode 1", rules[1], unexpected,
           rebuilt(modes, [*blocks_of(modes), block]))
    yield ("network-without-mode", "ENTROPY_NETWORK in a file without entropy mode 1", rules[0], unexpected,
           rebuilt(static, [*blocks_of(static), replace(network, layer=1)]))
    others = [one for one in blocks_of(modes) if one.kind != _NETWORK]
    yield ("network-early", "ENTROPY_NETWORK in layer 1, the first of entropy mode 1 is layer 2", rules[0], unexpected,
           rebuilt(modes, [*others, replace(network, layer=1)]))
    # Without other flags: no own inputs, no attention.
    yield ("network-flag-only", "the flag 4, and no other", *_HEADER,
           change_numbers(small, _NETWORK, renumber(("flags", 4))))

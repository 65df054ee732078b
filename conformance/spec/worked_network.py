"""The worked index network of SPEC.md, appendix C: every number from the inputs of an anchor to its frequencies.

The network is made here, and evaluated by the second decoder (decoders/python/index_network.py), written from the text.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from conformance.decoders.python.arithmetic import (
    Linear,
    Matrix,
    Vector,
    clamp,
    dot,
    exp2w,
    product,
    round_shift,
    sigmoid12,
)
from conformance.decoders.python.index_network import Coder, Network, frequencies, parse_network
from conformance.decoders.python.numbers import Numbers
from scarfmt.blocks.index_network import pack_network
from scarfmt.neural import arithmetic, network
from scarfmt.scene.model import Codebooks

BOOKS = Codebooks(np.array([[0, 0], [37, -12], [-50, 21], [14, 60]]), np.array([[1, -1], [24, 3], [19, -9], [30, -2]]))
FINE_VALUES = (700, -4100, 20000)
FIRST_INDEX = 2
"""The first index of the worked example, of stage 1."""

Rows = Iterator[tuple[str, str]]


def _layer(weights: Matrix, biases: Vector, shift: int) -> arithmetic.Linear:
    return arithmetic.Linear(np.array(weights, np.int32), np.array(biases, np.int64), shift)


def _array(values: Any) -> Any:
    return np.array(values, np.int64)


def worked_network() -> network.IndexNetwork:
    """The network."""
    inputs = [
        [[9, -4, 2], [-6, 3, 1], [12, 5, -3], [2, -8, 4], [-11, 14, -1], [7, 10, -2]],
        [[3, 5, -1], [8, -7, 3], [-4, 9, 2], [13, 6, -4], [-2, 15, 1], [10, -12, -3]],
    ]
    gru = network.GruLayer(
        inputs=tuple(np.array(matrix, np.int32) for matrix in inputs),
        recurrent=np.array([[4, -9], [5, 2], [-3, 7], [11, 6], [8, -5], [-10, 1]], np.int32),
        biases=_array([[30, -45, 60, 5, -20, 75]]),
        recurrent_biases=_array([-15, 25, 0, 40, 10, -35]),
        start=_array([20, -7]),
        shift=3,
    )
    attention = network.Attention(
        _layer([[6, -2], [3, 5]], [50, -30], 3),
        _layer([[7, 4], [-5, 8]], [-20, 35], 3),
        _layer([[9, -1], [2, 6]], [0, 44], 3),
        shift=5,
    )
    coarse = _layer([[5, -3, 2], [-4, 6, 1], [-3, 2, 5]], [8, -16, 20], 2)
    residual = _layer([[3, 7, -2], [2, -5, 4], [1, -2, 3]], [-12, 20, -30], 2)
    return network.IndexNetwork(
        activation_bits=8,
        inputs=network.Inputs(classes=1, own=True, attributes=3, depths=0, latents=0, latent_shift=0, grid=0),
        codeword_dims=2,
        codeword_shift=1,
        embed=(_layer([[3, -2, 1, 4], [-5, 2, 6, 7]], [40, -200], 3), _layer([[5, -3], [2, 7]], [12, -90], 3)),
        gru=(gru,),
        attention=attention,
        mixer=_layer([[4, -1, 2, 3], [-2, 5, 1, -3], [3, 2, -4, 6]], [64, 100, -50], 3),
        heads=(
            network.Head(coarse, _array([90, 0, -70, 33]), 3), network.Head(residual, _array([0, 15, -25, 40]), 1)
        ),
    )


def plain_network() -> Network:
    """The network read back from its block."""
    return parse_network(Numbers(pack_network(worked_network())))


def _show(value: Any) -> str:
    """A number, a vector, or the rows of a matrix."""
    if isinstance(value, int):
        return str(value)
    if value and isinstance(value[0], list):
        return "; ".join(_show(row) for row in value)
    return " ".join(str(v) for v in value) or "none"


def _linear_rows(name: str, layer: Linear) -> Rows:
    yield f"{name} weights", _show(layer.weights)
    yield f"{name} biases; shift", f"{_show(layer.biases)}; {layer.shift}"


def network_rows() -> Rows:
    """(what, numbers) of the network, in the order of its block."""
    net = plain_network()
    yield "codebook 0, codebook 1", f"{_show(BOOKS.coarse.tolist())} and {_show(BOOKS.residual.tolist())}"
    yield "codeword_shift", str(net.codeword_shift)
    for name, layer in zip(("embed1", "embed2"), net.embed, strict=True):
        yield from _linear_rows(name, layer)
    gru = net.gru[0]
    yield "Wi of codebook 0", _show(gru.wi[0])
    yield "Wi of codebook 1", _show(gru.wi[1])
    yield "Wh", _show(gru.wh)
    yield "bi of stage 1", _show(gru.bi[0])
    yield "bh", _show(gru.bh)
    yield "start; shift", f"{_show(gru.start)}; {gru.shift}"
    assert net.attention is not None
    for name, layer in zip(("query", "key", "value"), net.attention[:3], strict=True):
        yield from _linear_rows(name, layer)
    yield "score_shift", str(net.attention.shift)
    yield from _linear_rows("mixer", net.mixer)
    for number, head in enumerate(net.heads):
        yield from _linear_rows(f"head {number} project", head.project)
        yield f"head {number} biases; shift", f"{_show(head.biases)}; {head.shift}"


def evaluation_rows() -> Rows:
    """(what, numbers) of the evaluation, in the order of SPEC §10.5."""
    net = plain_network()
    coders = [Coder(net, head, book.tolist()) for head, book in zip(net.heads, _books(), strict=True)]
    x = [64, *(v >> 6 for v in FINE_VALUES)]
    yield "inputs: class, fine values >> 6", _show(x)
    x = [clamp(v, -net.amax, net.amax) for v in x]
    yield "clamped to -127..127", _show(x)
    yield "embed1.relu", _show(net.embed[0](x, 0, net.amax))
    h = net.embedding(x)
    yield "h = embed2.signed", _show(h)
    yield "words of codebook 0", _show(coders[0].words)
    yield "words of codebook 1", _show(coders[1].words)
    yield from _stage_one(net, coders[0], h)
    yield from _gru_rows(net, coders[0].words[FIRST_INDEX])
    tops = net.history([coders[0].words[FIRST_INDEX]])
    yield from _attention_rows(net, h, tops)
    y = net.mix(h, [coders[0].words[FIRST_INDEX]])
    yield "stage 2: y", _show(y)
    yield from _symbol_rows("stage 2", coders[1], y)


def _books() -> tuple[Any, Any]:
    return BOOKS.coarse, BOOKS.residual


def _stage_one(net: Network, coder: Coder, h: Vector) -> Rows:
    y = net.mix(h, [])
    yield "stage 1: seen = value.signed(start), alpha of one state being 256", _show(net.attend(h, net.history([])))
    yield "stage 1: y = mixer.relu(h, seen)", _show(y)
    yield from _symbol_rows("stage 1", coder, y)


def _symbol_rows(stage: str, coder: Coder, y: Vector) -> Rows:
    amax, logits = coder.network.amax, coder.logits(y)
    yield f"{stage}: o", _show(coder.project(y, -amax, amax))
    yield f"{stage}: logits", _show(logits)
    yield f"{stage}: weights exp2w", _show([exp2w(max(logits) - logit) for logit in logits])
    c = frequencies(logits)
    yield f"{stage}: F_0 .. F_n", _show(c)
    yield f"{stage}: frequencies", _show([b - a for a, b in itertools.pairwise(c)])


def _gru_rows(net: Network, u: Vector) -> Rows:
    gru = net.gru[0]
    width, s = len(gru.start), gru.shift
    px, ph = product(gru.wi[0], u, gru.bi[0]), product(gru.wh, gru.start, gru.bh)
    sums = [round_shift(a + b, s) for a, b in zip(px, ph, strict=True)]
    z, r = ([sigmoid12(v) for v in sums[k * width : (k + 1) * width]] for k in (0, 1))
    kept = [round_shift(a * clamp(round_shift(v, s), -2047, 2047), 12) for a, v in zip(r, ph[2 * width :], strict=True)]
    yield f"stage 1 in recurrent: x = word of index {FIRST_INDEX}", _show(u)
    yield "stage 1 in recurrent: px", _show(px)
    yield "stage 1 in recurrent: ph", _show(ph)
    gates = f"{_show(sums[:width])}; {_show(sums[width : 2 * width])}"
    yield "stage 1 in recurrent: arguments of update; reset", gates
    yield "stage 1 in recurrent: update; reset", f"{_show(z)}; {_show(r)}"
    yield "stage 1 in recurrent: kept", _show(kept)
    arguments = [round_shift(a, s) + b for a, b in zip(px[2 * width :], kept, strict=True)]
    yield "stage 1 in recurrent: argument of candidate", _show(arguments)
    yield "stage 1 in recurrent: candidate", _show([net.state(v) for v in arguments])
    yield "stage 1 in recurrent: new state, history_1", _show(net.history([u])[1])


def _attention_rows(net: Network, h: Vector, tops: Matrix) -> Rows:
    assert net.attention is not None
    query, key, value, shift = net.attention
    q, keys = query(h, -127, 127), [key(g, -127, 127) for g in tops]
    scores = [round_shift(dot(q, k), shift) for k in keys]
    weights = [exp2w(max(scores) - score) for score in scores]
    yield "stage 2: q", _show(q)
    yield "stage 2: key_0; key_1", _show(keys)
    yield "stage 2: value_0; value_1", _show([value(g, -net.amax, net.amax) for g in tops])
    yield "stage 2: scores", _show(scores)
    yield "stage 2: share_m; alpha_m", f"{_show(weights)}; {_show([256 * w // sum(weights) for w in weights])}"
    yield "stage 2: seen", _show(net.attend(h, tops))


def table_text(rows: Rows) -> str:
    """The rows as SPEC.md prints them."""
    return "\n".join(["| what | numbers |", "|---|---|", *(f"| {what} | {numbers} |" for what, numbers in rows), ""])

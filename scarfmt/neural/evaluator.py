"""Evaluation of the index network: rows of frequencies for the symbols of many anchors (SPEC §10.5).

Arrays are binary32 and carry integers, or integers divided by a power of two: rounding shifts are folded into the
weights, and every operation is exact for what a valid network gives it (SPEC §10.1).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import F32, F64, I64, Ints, Numbers
from scarfmt.entropy.rans import TOTAL
from scarfmt.errors import InvalidInput
from scarfmt.neural.arithmetic import Linear, fold
from scarfmt.neural.grid import HashGrid
from scarfmt.neural.network import QUERY_AMAX, Attention, GruLayer, IndexNetwork
from scarfmt.neural.tables import EXP2_LAST, LAST, exp2_table, sigmoid_table, state_table
from scarfmt.scene.model import Codebooks

_ROWS, _ELEMENTS = 2048, 1 << 17
"""Anchors that are worked on at once, and numbers of an array of theirs: it stays in the cache."""
_RECURRENT_AMAX = 2047
_GATE_ONE = 4096
_SHARE_ONE = 256

_EXP2 = exp2_table().astype(np.float64)
_SIGMOID = (sigmoid_table() / _GATE_ONE).astype(np.float32)



@dataclass(frozen=True)
class State:
    """The state of the network after some indices of n anchors.

    Attributes:
        layers: newest (n, H) state of each recurrent layer.
        history: (n, H) states of the top layer, from the start state on, one more than indices are known.
    """

    layers: tuple[F32, ...]
    history: tuple[F32, ...]


class Evaluator:
    """The network of a scene, prepared for its codebooks. Threads may share one.

    Args:
        network: valid for `books` (:meth:`IndexNetwork.check`).
        books: a codebook may be empty if none of its indices are to be coded.
        grid: the hash grid, if the network reads one.

    Attributes:
        network, books, grid: as given.
    """

    def __init__(self, network: IndexNetwork, books: Codebooks, grid: HashGrid | None = None) -> None:
        self.network, self.books, self.grid, self._amax = network, books, grid, network.amax
        words = [network.codewords(book) for book in (books.coarse, books.residual)][: len(network.heads)]
        self._gru = [_Recurrence(layer, network.activation_bits) for layer in network.gru]
        # What the first layer makes of each codeword, by codebook.
        self._tokens = [
            book.astype(np.float32) @ matrix for book, matrix in zip(words, self._gru[0].inputs, strict=False)
        ]
        # round_shift(<e, o> + b, s) of the codewords e of each book; none of one that is still empty.
        self._logits = {
            number: Linear(book.astype(np.int32), head.biases, head.shift)
            for number, (head, book) in enumerate(zip(network.heads, words, strict=True))
            if len(book)
        }

    def embed(self, x: Numbers) -> F32:
        """(n, H) embeddings h of n anchors.

        Args:
            x: (n, width) integers of any dtype, the columns of SPEC §10.5; clamped here.
        """
        first, second, amax = *self.network.embed, self._amax

        def embedded(part: Numbers) -> F32:
            return second.signed(first.relu(np.clip(part.astype(np.float32), -amax, amax), amax), amax)

        return _by_parts(embedded, x.shape[1], x)

    def start(self, count: int) -> State:
        """The state of `count` anchors of which no index is known."""
        layers = tuple(np.tile(layer.start.astype(np.float32), (count, 1)) for layer in self.network.gru)
        return State(layers, layers[-1:])

    def take(self, state: State, rows: Ints) -> State:
        """The state of the anchors `rows`, (m,) positions."""
        return State(tuple(layer[rows] for layer in state.layers), tuple(layer[rows] for layer in state.history))

    def advance(self, state: State, stage: int, codes: Ints) -> State:
        """The state after the indices of one more stage.

        Args:
            stage: theirs, the one that follows those known; the last stage of a scene is no token.
            codes: (n,) codeword numbers, below the size of the stage's codebook.

        Raises:
            InvalidInput: ``input-stage`` for another stage or number of indices.
        """
        tokens = len(self.network.gru[0].biases)
        if stage != len(state.history) or stage > tokens or len(codes) != len(state.history[0]):
            raise InvalidInput("input-stage", f"{len(codes)} indices of stage {stage} do not follow", field="stage")
        first = self._gru[0]
        products = self._tokens[int(stage > 1)][codes] + first.biases[stage - 1]
        layers = [_by_parts(first.step, products.shape[1], products, state.layers[0])]
        for layer, before in zip(self._gru[1:], state.layers[1:], strict=True):
            products = layers[-1] @ layer.inputs[0] + layer.biases[0]
            layers.append(_by_parts(layer.step, products.shape[1], products, before))
        return State(tuple(layers), (*state.history, layers[-1]))

    def mix(self, h: F32, state: State) -> F32:
        """(n, Y) y of the stage that follows `state`, of the embeddings `h` of the same anchors."""
        mixer, attention, amax = self.network.mixer, self.network.attention, self._amax

        def mix(h: F32, *history: F32) -> F32:
            c = history[-1] if attention is None else _attend(attention, h, history, amax)
            return mixer.relu(np.concatenate([h, c], axis=1), amax)

        return _by_parts(mix, mixer.inputs, h, *state.history)

    def frequency_blocks(self, book: int, y: F32) -> Iterator[F64]:
        """float64 f - 1 of the codewords of a book, for n anchors in order, some rows at a time.

        Args:
            y: (n, Y).
        """
        project, logits = self.network.heads[book].project, self._logits[book]
        for part in _parts(len(y), logits.outputs):
            yield frequency_rows(logits.round(project.signed(y[part], self._amax)))


class _Recurrence:
    """One recurrent layer; columns in the order z, r, n.

    Attributes:
        inputs: (R, 3H) or (H, 3H) input matrices; biases: (tokens, 3H) of their products. Neither rounds.
    """

    def __init__(self, layer: GruLayer, activation_bits: int) -> None:
        self._width, self._half = len(layer.start), 0.5 if layer.shift else 0.0
        self.inputs = [fold(matrix, layer.recurrent_biases, layer.shift)[0] for matrix in layer.inputs]
        self.biases = (layer.biases * 0.5**layer.shift).astype(np.float32)
        # The half of their rounding is in the biases of these.
        self._recurrent, self._recurrent_biases = fold(layer.recurrent, layer.recurrent_biases, layer.shift)
        self._tanh = state_table(activation_bits).astype(np.float32)

    def step(self, products: F32, state: F32) -> F32:
        """(n, H) the new state, of the (n, 3H) products of the input, biases included, and the (n, H) state."""
        gates, width = 2 * self._width, self._width
        around = state @ self._recurrent + self._recurrent_biases
        opened = _SIGMOID[_place(np.floor(products[:, :gates] + around[:, :gates]))]
        kept = np.clip(np.floor(around[:, gates:]), -_RECURRENT_AMAX, _RECURRENT_AMAX)
        new = np.floor(products[:, gates:] + self._half) + np.floor(opened[:, width:] * kept + 0.5)
        candidate = self._tanh[_place(new)]
        # z g + (1 - z) n as n + z (g - n): 11 bits before the point, the 12 of z after it.
        return np.asarray(np.floor(candidate + opened[:, :width] * (state - candidate) + 0.5))


def _place(x: F32) -> I64:
    """Places of integers in a table of -LAST..LAST."""
    return np.asarray((np.clip(x, -LAST, LAST) + LAST).astype(np.int64))


def _attend(attention: Attention, h: F32, history: tuple[F32, ...], amax: int) -> F32:
    """(n, H) c of n anchors, of (n, H) embeddings and all states of the top layer."""
    query, half = attention.query.signed(h, QUERY_AMAX), 0.5 if attention.shift else 0.0
    keys = (attention.key.signed(state, QUERY_AMAX) for state in history)
    products = np.stack([np.einsum("ij,ij->i", query, key) for key in keys])
    scores = np.floor(products * np.float32(0.5**attention.shift) + np.float32(half))
    weights = _powers(scores.max(axis=0) - scores)
    # One division after an exact product: the quotient then rounds to an integer only if it is one.
    shares = (np.floor(weights * _SHARE_ONE / weights.sum(axis=0)) / _SHARE_ONE).astype(np.float32)
    values = (attention.value.signed(state, amax) for state in history)
    # No clamp: the shares sum to at most 1.
    return np.asarray(np.floor(sum(share[:, None] * value for share, value in zip(shares, values, strict=True)) + 0.5))


def _powers(distances: F32) -> F64:
    """exp2w of integers; those above 2^24 are not exact, and need not be: from 512 on it is 0."""
    return np.asarray(_EXP2[np.minimum(distances, EXP2_LAST + 1).astype(np.int64)])


def frequency_rows(logits: F32) -> F64:
    """(n, k) float64 f - 1 of symbols with (n, k) logits."""
    prefix = np.cumsum(_powers(logits.max(axis=1, keepdims=True) - logits), axis=1)
    totals = prefix[:, -1:].copy()
    return np.diff(np.floor(prefix * (TOTAL - prefix.shape[1]) / totals), axis=1, prepend=0.0)


def _parts(count: int, columns: int) -> Iterator[slice]:
    """Rows 0..count-1 of arrays of so many columns, cut."""
    step = max(1, min(_ROWS, _ELEMENTS // columns))
    return (slice(first, min(first + step, count)) for first in range(0, count, step))


def _by_parts(function: Callable[..., F32], columns: int, *arrays: Numbers) -> F32:
    """A function of rows with so many columns, applied to some at a time."""
    parts = list(_parts(len(arrays[0]), columns)) or [slice(0, 0)]
    return np.concatenate([function(*(array[part] for array in arrays)) for part in parts])

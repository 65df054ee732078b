"""Fast evaluation of the index network: rows of frequencies for the symbols of many anchors (SPEC §10.5).

The same integers as the definition, fewer operations: what depends on the embedding alone (the query, and
h's share of the mixer) is computed once an anchor; what depends on one codeword alone (its input products,
and every state after the first token) is a table made once; rounding shifts are folded into the weights.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import F32, F64, I64, Ints, Numbers
from scarfmt.errors import InvalidInput
from scarfmt.neural.network import IndexNetwork
from scarfmt.neural.operations import NUMPY, Array
from scarfmt.neural.parts import GATES, Attending, Logits, Predicting, Recurrence, Rounded
from scarfmt.neural.tables import exp2_table
from scarfmt.scene.model import Codebooks


@dataclass(frozen=True)
class State:
    """The state of the network after some indices of `count` anchors.

    Attributes:
        count: anchors.
        stage: indices known of each, 0 or more.
        layers: newest (count, H) state of each recurrent layer; empty at stage 0, where all have the start state.
        keys, values: (count, H) of each token, in order; empty without attention.
    """

    count: int
    stage: int
    layers: tuple[Array, ...]
    keys: tuple[Array, ...]
    values: tuple[Array, ...]


@dataclass(frozen=True)
class Block:
    """Symbols to code in one call.

    Attributes:
        rows: (m,) int64 positions among the anchors asked for, in coding order.
    """

    rows: I64
    _scores: Array
    _frequencies: Callable[[Array], F64]

    def weights(self) -> F64:
        """(m, k) float64 f - 1, one row a symbol. To be asked for once: it uses up the logits."""
        return self._frequencies(self._scores)


class Evaluator:
    """The network of a scene, prepared for its codebooks. Threads may share one.

    Args:
        network: valid for `books` (:meth:`IndexNetwork.check`).
        books: a codebook may be empty if none of its indices are to be coded.

    Attributes:
        network, books: as given.
        embedding: its two layers.
        mix_embedding, mix_biases, mix_state: the mixer's (H, Y) share of h, its (Y,) biases and its (H, Y) share of c.
        mix_start: (1, Y) what c adds while no index is known.
        gru: recurrent layers.
        first: the state after each coarse codeword; that of no anchors where no index is a token.
        attend: the attention, or None.
        heads: by number of the codebook, of those that are not empty.
    """

    def __init__(self, network: IndexNetwork, books: Codebooks) -> None:
        self.network, self.books = network, books
        self._do, self._amax, h = NUMPY, network.amax, network.hidden
        self.embedding = (
            Rounded(network.embed[0], NUMPY, 0, network.amax),
            Rounded(network.embed[1], NUMPY, -network.amax, network.amax),
        )
        weights, biases = network.mixer.folded
        self.mix_embedding, self.mix_biases = NUMPY.constant(weights[:h]), NUMPY.constant(biases)
        self.mix_state = NUMPY.constant(weights[h:])
        words = [network.codewords(book) for book in (books.coarse, books.residual)][: len(network.heads)]
        self.gru = [
            Recurrence(layer, [] if number else words, network.activation_bits, NUMPY)
            for number, layer in enumerate(network.gru)
        ]
        start = network.gru[-1].start
        self.attend: Attending | None = None
        if network.attention is not None:
            self.attend = Attending(network.attention, start, network.amax, NUMPY)
        # A codebook is empty while no layer that needs it was read: nothing is coded with its head.
        self.heads = {
            number: Predicting(head, book, network.amax, NUMPY)
            for number, (head, book) in enumerate(zip(network.heads, words, strict=True))
            if len(book)
        }
        self._exp2 = NUMPY.constant(exp2_table())
        # Attention over one state is the value of that state.
        context = NUMPY.constant(start[None]) if self.attend is None else self.attend.first_value
        self.mix_start = NUMPY.product(context, self.mix_state)
        self._tokens = len(network.gru[0].biases)
        self.first = self._after_first_token(network, len(words[0])) if self._tokens else self.start(0)

    def _after_first_token(self, network: IndexNetwork, codewords: int) -> State:
        """The state after each of the coarse codewords: the first token decides it alone."""
        starts = tuple(self._do.constant(np.tile(layer.start, (codewords, 1))) for layer in network.gru)
        return State(codewords, 1, *self._step(starts, 1, self._do.index(np.arange(codewords))))

    def _chunks(self, count: int, columns: int) -> Iterator[slice]:
        """Rows 0..count-1 of arrays of so many columns, cut."""
        step = max(1, min(self._do.chunk, self._do.elements // columns))
        return (slice(first, min(first + step, count)) for first in range(0, count, step))

    def embed(self, x: Numbers, observe: Callable[[F32], None] | None = None) -> Array:
        """The embedding of the decoded context of n anchors: (n, Y), or (n, Y + H) with attention.

        The columns are h's share of the mixer and the query; rows may be selected by indexing.

        Args:
            x: (n, width) integers of any dtype, the columns of SPEC §10.5; clamped here.
            observe: shown the embeddings h, (m, H), in order.
        """
        width = self.mix_embedding.shape[1]
        queries = 0 if self.attend is None else self.mix_embedding.shape[0]
        out = self._do.empty(len(x), width + queries)
        for part in self._chunks(len(x), x.shape[1]):
            h = self.embedding[1](self.embedding[0](self._do.lift(x[part], self._amax)))
            if observe is not None:
                observe(self._do.lower(h))
            out[part, :width] = self._do.product(h, self.mix_embedding)
            out[part, :width] += self.mix_biases
            if self.attend is not None:
                out[part, width:] = self.attend.query(h)
        return out

    def start(self, count: int) -> State:
        """The state of `count` anchors of which no index is known."""
        return State(count, 0, (), (), ())

    def take(self, state: State, rows: Ints) -> State:
        """The state of the anchors `rows`, (m,) positions."""
        chosen = self._do.index(rows)
        layers, keys, values = (
            tuple(self._do.take(array, chosen) for array in arrays)
            for arrays in (state.layers, state.keys, state.values)
        )
        return State(len(rows), state.stage, layers, keys, values)

    def advance(self, state: State, stage: int, codes: Ints) -> State:
        """The state after the indices of one more stage.

        Args:
            stage: theirs, that of `state` plus 1; the last stage of a scene is no token.
            codes: (count,) codeword numbers, below the size of the stage's codebook.

        Raises:
            InvalidInput: ``input-stage`` for another stage or number of indices.
        """
        if stage != state.stage + 1 or stage > self._tokens or len(codes) != state.count:
            raise InvalidInput("input-stage", f"{len(codes)} indices of stage {stage} do not follow", field="stage")
        if stage == 1:
            return self.take(self.first, codes)
        chosen = self._do.index(codes)
        columns = state.layers + state.keys[-1:] + state.values[-1:]
        new = [self._do.empty(state.count, column.shape[1]) for column in columns]
        for part in self._chunks(state.count, GATES * columns[0].shape[1]):
            layers, key, value = self._step(tuple(layer[part] for layer in state.layers), stage, chosen[part])
            for whole, piece in zip(new, layers + key + value, strict=True):
                whole[part] = piece
        depth = len(self.gru)
        keys, values = tuple(new[depth : depth + 1]), tuple(new[depth + 1 :])
        return State(state.count, stage, tuple(new[:depth]), state.keys + keys, state.values + values)

    def _step(
        self, states: tuple[Array, ...], stage: int, codes: Array
    ) -> tuple[tuple[Array, ...], tuple[Array, ...], tuple[Array, ...]]:
        """New states of all layers, and the key and value of the top one (none without attention)."""
        new = [self.gru[0].step(self.gru[0].token_products(stage, codes), states[0])]
        for layer, state in zip(self.gru[1:], states[1:], strict=True):
            new.append(layer.step(layer.state_products(new[-1]), state))
        if self.attend is None:
            return tuple(new), (), ()
        return tuple(new), (self.attend.key(new[-1]),), (self.attend.value(new[-1]),)

    def mixed(self, h: Array, state: State) -> Array:
        """(n, Y) y of the stage that follows `state`, of the embeddings `h` of the same anchors."""
        width = self.mix_embedding.shape[1]
        out = self._do.empty(state.count, width)
        for part in self._chunks(state.count, width):
            mix = h[part, :width] + self._share_of_state(h[part, width:], state, part)
            out[part] = self._do.clip_(self._do.floor_(mix), 0, self._amax)
        return out

    def _share_of_state(self, query: Array, state: State, part: slice) -> Array:
        """(n, Y) or (1, Y) what c adds to the mixer."""
        if not state.stage:
            return self.mix_start
        if self.attend is None:
            return self._do.product(state.layers[-1][part], self.mix_state)
        c = self.attend(query, [key[part] for key in state.keys], [value[part] for value in state.values])
        return self._do.product(c, self.mix_state)

    def first_blocks(self, book: int, y: Array) -> Iterator[Block]:
        """The first symbols of n anchors, in order: codewords of a flat head, clusters of a two-level one.

        A few anchors at a time: coded at once, their rows never leave the cache.
        """
        head = self.heads[book]
        return self._blocks(head.projections[0], head.top, y)

    def _blocks(self, projection: Rounded, logits: Logits, y: Array) -> Iterator[Block]:
        for part in self._chunks(len(y), logits.count):
            yield Block(np.arange(part.start, part.stop), logits(projection(y[part])), self._frequencies)

    def _frequencies(self, logits: Array) -> F64:
        return self._do.frequency_rows(logits, self._exp2)

    def member_blocks(self, book: int, y: Array, clusters: Ints) -> Iterator[Block]:
        """The members of n anchors: clusters ascend, order is kept in a cluster, clusters of one codeword are left out.

        Args:
            y: (n, Y).
            clusters: (n,) the cluster of each anchor.
        """
        head = self.heads[book]
        # Of 16 bits, NumPy sorts by digits, many times faster.
        order = np.argsort(clusters.astype(np.int16), kind="stable")
        ends = np.searchsorted(clusters[order], np.arange(len(head.sizes) + 1))
        for first, last in head.equal_runs():
            edges = ends[first : last + 1] - ends[first]
            for part in self._chunks(int(edges[-1]), head.sizes[first]):
                rows = order[ends[first] + part.start : ends[first] + part.stop]
                o = head.projections[1](self._do.take(y, self._do.index(rows)))
                logits = self._member_logits(head, o, first, np.clip(edges - part.start, 0, len(rows)))
                yield Block(rows, logits, self._frequencies)

    def _member_logits(self, head: Predicting, o: Array, first: int, edges: I64) -> Array:
        """(size, m) logits of anchors sorted by cluster: first + i has those from edges[i] to edges[i + 1]."""
        logits = self._do.empty(head.sizes[first], len(o))
        for cluster in np.flatnonzero(np.diff(edges)).tolist():
            own = slice(int(edges[cluster]), int(edges[cluster + 1]))
            logits[:, own] = head.members[first + cluster](o[own])
        return logits

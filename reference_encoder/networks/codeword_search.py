"""The cheapest codewords after each of several beginnings, without pricing all of them (encoder side).

A codeword costs worth * (squared distance) + bits. Distances to all are cheap; what a codeword costs in its cluster is
not, but a cluster's own price is, and no member costs less than that. So clusters are opened by ascending lower bound
until none is likely to hold a better codeword than those found.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from reference_encoder.jit import compiled
from reference_encoder.loops import add_products, first_of_least, powers, products, summed, top_of
from reference_encoder.networks.head import HeadModel
from reference_encoder.tuning import LEAST_INSIDE
from scarfmt.arrays import F32, I64

_DEAREST = np.float32(24.0)
"""Bits a symbol costs at most: none has a frequency below 1 of 2^24."""
_FAR = np.float32(1e30)


@dataclass(frozen=True)
class CodewordSearch:
    """A codebook and what its head says of codewords.

    Attributes:
        words: (n, d) float32.
        head: of the book.
        starts: (C + 1,) first codeword of each cluster, and n; of a flat head each codeword is its own cluster.
        slots: (S * C,) the s-th codeword of cluster c at s * C + c, -1 for none: all clusters side by side.
        arranged: (d, S * C) words in these slots.
        vectors, biases: (R, symbols) and (symbols,) of the head's levels, in bits; the second of a flat head is empty.
    """

    words: torch.Tensor
    head: HeadModel
    starts: I64
    slots: I64
    arranged: F32
    vectors: tuple[F32, F32]
    biases: tuple[F32, F32]

    @classmethod
    def of(cls, words: torch.Tensor, head: HeadModel) -> CodewordSearch:
        """For a book in the order of the clusters of `head`."""
        starts = np.concatenate([[0], np.cumsum(head.sizes or (1,) * len(words))])
        grid = np.arange(np.diff(starts).max())[:, None] + starts[:-1]
        slots = np.where(grid < starts[1:], grid, -1).ravel()
        arranged = np.where(slots >= 0, words.numpy().T[:, slots], np.float32(0))
        levels = [head.level(number) for number in range(len(head.levels))]
        vectors = [level.scaled.numpy() for level in levels]
        biases = [(level.biases(True) * level.scale).numpy() for level in levels]
        none = np.zeros((vectors[0].shape[0], len(words)), np.float32), np.zeros(len(words), np.float32)
        second = (vectors[1], biases[1]) if len(levels) > 1 else none
        return cls(
            words, head, starts, slots, np.ascontiguousarray(arranged), (vectors[0], second[0]), (biases[0], second[1])
        )

    def cheapest(
        self,
        left: torch.Tensor,
        y: torch.Tensor,
        spent: torch.Tensor,
        worth: torch.Tensor,
        slope: torch.Tensor,
        keep: int,
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """(m, keep) beginnings, codewords and bits spent so far of the cheapest that follow m times w beginnings.

        Cost is worth * (slope @ (left - codeword)^2) + spent + bits of the codeword.

        Args:
            left: (m * w, d) what each beginning leaves, those of one anchor side by side.
            y: (m * w, Y) mixed contexts.
            spent: (m * w,) bits of each beginning.
            worth: (m,) and slope (d,), as above.
            keep: at most as many as there are codewords.
        """
        count = len(worth)
        outputs = [self.head.level(number).outputs(y, True).numpy() for number in range(len(self.head.levels))]
        norms = np.where(self.slots >= 0, ((self.words * self.words) @ slope).numpy()[self.slots], _FAR)
        places, bits = np.empty((count, keep), np.int64), np.empty((count, keep), np.float32)
        _cheapest(
            (left * (-2 * slope)).numpy(),
            (left * left * slope).sum(1).numpy(),
            outputs[0],
            outputs[-1],
            spent.numpy(),
            worth.numpy(),
            self.starts,
            self.arranged,
            norms,
            self.vectors,
            self.biases,
            LEAST_INSIDE,
            places,
            bits,
        )
        number, code = np.divmod(places, len(self.words))
        return torch.from_numpy(number), torch.from_numpy(code), torch.from_numpy(bits)


@compiled
def _price(output: F32, vectors: F32, biases: F32, scratch: F32, out: F32) -> None:
    """Fill `out` (k,) with bits of all symbols of a softmax; `scratch` is as long."""
    products(output, vectors, biases, scratch)
    top = top_of(scratch)
    for k in range(len(out)):
        scratch[k] -= top
    powers(scratch, out)
    total = np.float32(np.log2(summed(out)))
    for k in range(len(out)):
        out[k] = min(total - scratch[k], _DEAREST)


@compiled
def _cheapest_of_clusters(distances: F32, least: F32) -> None:
    """Fill `least` (C,) with the smallest of the (S * C,) distances of each cluster."""
    count = len(least)
    least[:] = distances[:count]
    for slot in range(1, len(distances) // count):
        here = distances[slot * count : (slot + 1) * count]
        for k in range(count):
            least[k] = min(least[k], here[k])


@compiled
def _distances(steep: F32, square: float, worth: float, arranged: F32, norms: F32, out: F32) -> None:
    """Fill `out` (S * C,) with worth * distance^2 to every codeword."""
    for k in range(len(out)):
        out[k] = square + norms[k]
    add_products(steep, arranged, out)
    for k in range(len(out)):
        out[k] *= worth


@compiled
def _cheapest(
    steep: F32,
    squares: F32,
    first: F32,
    second: F32,
    spent: F32,
    worth: F32,
    starts: I64,
    arranged: F32,
    norms: F32,
    vectors: tuple[F32, F32],
    biases: tuple[F32, F32],
    least_inside: float,
    places: I64,
    bits: F32,
) -> None:
    """Fill `places` (m, keep) with beginning * n + codeword by ascending cost, and `bits` with what is spent then.

    Args:
        steep, squares: (m * w, d) and (m * w,) of what is left: -2 slope * left, and slope * left^2 summed.
        first, second: (m * w, R) outputs of both levels.
        norms: (S * C,) slope * word^2 summed, in slots.
        least_inside: :data:`LEAST_INSIDE`; an argument, because compiled code does not see it change.
    """
    anchors, keep = places.shape
    clusters, wide, words = len(starts) - 1, len(steep) // max(anchors, 1), starts[-1]
    distances, prices = np.empty((wide, len(norms)), np.float32), np.empty((wide, clusters), np.float32)
    bounds, least = np.empty(wide * clusters, np.float32), np.empty(clusters, np.float32)
    scratch, inside, costs = np.empty(words, np.float32), np.empty(words, np.float32), np.empty(keep, np.float32)
    inner = (least_inside * np.log2(np.diff(starts))).astype(np.float32)
    for anchor in range(anchors):
        for beam in range(wide):
            row = anchor * wide + beam
            _distances(steep[row], squares[row], worth[anchor], arranged, norms, distances[beam])
            _cheapest_of_clusters(distances[beam], least)
            _price(first[row], vectors[0], biases[0], scratch[:clusters], prices[beam])
            for k in range(clusters):
                prices[beam, k] += spent[row]
                bounds[beam * clusters + k] = least[k] + prices[beam, k] + inner[k]
        costs[:] = np.inf
        while True:
            best = first_of_least(bounds)
            if bounds[best] >= costs[keep - 1]:
                break
            bounds[best] = np.inf
            beam, cluster = best // clusters, best % clusters
            start, stop = starts[cluster], starts[cluster + 1]
            inside[0] = 0
            if stop - start > 1:
                size, row = stop - start, anchor * wide + beam
                _price(second[row], vectors[1][:, start:stop], biases[1][start:stop], scratch[:size], inside[:size])
            for k in range(stop - start):
                price = prices[beam, cluster] + inside[k]
                cost = distances[beam, k * clusters + cluster] + price
                if cost < costs[keep - 1]:
                    at = _insert(costs, cost, places[anchor], bits[anchor])
                    places[anchor, at], bits[anchor, at] = beam * words + start + k, price


@compiled
def _insert(costs: F32, cost: float, places: I64, bits: F32) -> int:
    """Make room for `cost` among ascending `costs`, dropping the last; where it is now."""
    at = len(costs) - 1
    while at > 0 and costs[at - 1] > cost:
        costs[at], places[at], bits[at] = costs[at - 1], places[at - 1], bits[at - 1]
        at -= 1
    costs[at] = cost
    return at

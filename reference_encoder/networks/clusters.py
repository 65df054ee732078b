"""Orders a codebook into contiguous clusters of like codewords, for the two-level head of the index network.

A cluster is found by halving: codewords are sorted along the axis in which they spread most, and split where the
numbers of clusters on both sides want it. The zero codeword, by far the most frequent where a stage often adds
nothing, is a cluster of its own, so that coding it takes a single symbol.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from reference_encoder.tuning import FEWEST_CLUSTERED
from scarfmt.arrays import F64, I64
from scarfmt.scene.codebooks import Codebooks


@dataclass(frozen=True)
class Clusters:
    """A new order of a codebook.

    Attributes:
        order: (n,) old number of each codeword in the new order.
        sizes: codewords of each cluster, in the new order; empty: the book is coded flat.
    """

    order: I64
    sizes: tuple[int, ...]

    @property
    def ranks(self) -> I64:
        """(n,) new number of each old codeword: the map for indices."""
        ranks = np.empty(len(self.order), np.int64)
        ranks[self.order] = np.arange(len(self.order))
        return ranks


def cluster(words: I64, uses: I64) -> Clusters:
    """Clusters of similar size, about the square root of n of them.

    Args:
        words: (n, d) codewords.
        uses: (n,) how often each is used; within a cluster the most used come first.
    """
    if len(words) < FEWEST_CLUSTERED:
        return Clusters(np.arange(len(words)), ())
    zero = np.flatnonzero(~words.any(axis=1))[:1]
    rest = np.setdiff1d(np.arange(len(words)), zero)
    groups = _halved(words.astype(np.float64), rest, round(float(np.sqrt(len(rest)))))
    # Clusters of one size side by side are evaluated together.
    arranged = [group[np.argsort(-uses[group], kind="stable")] for group in sorted(groups, key=len)]
    arranged = [zero, *arranged] if len(zero) else arranged
    return Clusters(np.concatenate(arranged), tuple(len(group) for group in arranged))


def _halved(words: F64, members: I64, clusters: int) -> list[I64]:
    """`members` split into `clusters` groups, sizes as equal as can be."""
    if clusters <= 1:
        return [members]
    left = clusters // 2
    centred = words[members] - words[members].mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    axis = axes[:, -1]
    # An eigenvector has no sign of its own.
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    order = members[np.argsort(np.round(centred @ axis, 6), kind="stable")]
    cut = round(len(order) * left / clusters)
    return _halved(words, order[:cut], left) + _halved(words, order[cut:], clusters - left)


def arrange(books: Codebooks, uses: tuple[I64, I64]) -> tuple[Codebooks, tuple[Clusters, Clusters]]:
    """Both books in the order of their clusters, and the clusters.

    Args:
        uses: (n,) uses of each codeword, per book.
    """
    found = cluster(books.coarse, uses[0]), cluster(books.residual, uses[1])
    return Codebooks(books.coarse[found[0].order], books.residual[found[1].order]), found

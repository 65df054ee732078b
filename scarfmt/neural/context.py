"""Decoded context: what the anchors of an octree cell that are already known say about the next (SPEC §10.2).

Anchors known in a tile-layer are ordered by (Morton code, index). A cell of depth e holds those whose codes agree
after dropping 3e bits. Groups of symbols travel in passes, so that an anchor sees those of earlier passes around it.
Everything is exact: float64 arrays here carry integers whose sums stay far below 2^53.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scarfmt.arrays import F64, I32, I64, U64, Ints, Numbers
from scarfmt.limits import MAX_LOCAL_BITS
from scarfmt.scene.model import MAX_STEPS

FINE_LIMIT = 1 << 24
"""Fixed-point values are clamped to it: 2^14 first cells. A cell's sum over 2^20 anchors stays below 2^53."""

COUNT_UNIT, COUNT_TOP = 32, 8
"""A count feature is 32 for every binary digit of the count, 8 digits at most."""

_FINE_ONE = 1024
_POWERS = 3.0 ** np.arange(MAX_STEPS)
# 8^0 .. 8^21: how many of them are <= the XOR of two codes is the least depth that joins them.
_OCTANTS = np.array([1 << (3 * e) for e in range(MAX_LOCAL_BITS + 1)], np.uint64)


def cell_power(steps: Ints) -> F64:
    """3^(n - 1) for n steps; 1 for n = 0, where no value is known."""
    return np.asarray(_POWERS[np.maximum(steps, 1) - 1])


def put_fine(values: Ints, steps: Ints, out: I32) -> None:
    """Put values in 1024ths of the first cell, nearest with ties up, in -2^24..2^24, into `out` (SPEC §10.2).

    Args:
        values: (n, components) v after `steps` steps, |v| < 2^31.
        steps: (n,), or (1,) for all, ternary steps received, 0..20; with none the value is 0.
        out: (n, components) int32, its rows anywhere.
    """
    power = cell_power(steps)[:, None]
    # Exact: the numerator is below 2^43, and the quotient of integers so small never rounds up to the next integer.
    scaled = np.floor((values * (2.0 * _FINE_ONE) + power) / (2 * power))
    np.clip(scaled, -FINE_LIMIT, FINE_LIMIT, out=scaled)
    scaled *= (steps > 0)[:, None]
    out[:] = scaled


def fine(values: Ints, steps: Ints) -> I64:
    """(n, components) int64 fine values; arguments as of :func:`put_fine`."""
    out = np.empty(values.shape, np.int32)
    put_fine(values, steps, out)
    return out.astype(np.int64)


def joining_depths(codes: U64) -> I64:
    """(n - 1,) least depth at which each code of ascending `codes` shares a cell with the one before it."""
    return np.searchsorted(_OCTANTS, codes[1:] ^ codes[:-1], side="right").astype(np.int64)


def depth_shifts(codes: U64, bits: int, occupancies: Sequence[int]) -> list[int]:
    """The depth of each occupancy target (SPEC §10.2): the least at which its cells hold so many anchors on average.

    Args:
        codes: (n,) ascending Morton codes of the anchors known, below 8^bits.
        bits: local bits per axis, the greatest depth.
        occupancies: targets, 1..65535.
    """
    if not len(codes):
        return [0] * len(occupancies)
    # Every neighbour in code order that is joined at depth e is a cell fewer.
    cells = len(codes) - np.cumsum(np.bincount(joining_depths(codes), minlength=bits + 1)[: bits + 1])
    return [min(int(np.count_nonzero(cells * target > len(codes))), bits) for target in occupancies]


def passes(count: int, passes_log2: int) -> list[I64]:
    """Ranks 0..count-1 of a cohort, split into passes (SPEC §10.2): every 2^passes_log2-th, then those halfway."""
    step = 1 << passes_log2
    out = [np.arange(0, count, step)]
    while step > 1:
        out.append(np.arange(step // 2, count, step))
        step //= 2
    return out


class Cells:
    """The cells of all anchors known in one tile-layer, at each depth.

    Anchors are rows, by ascending (Morton code, index).

    Args:
        codes: (n,) ascending Morton codes.
        shifts: depths from :func:`depth_shifts`, coarse first.
    """

    def __init__(self, codes: U64, shifts: Sequence[int]) -> None:
        joining = joining_depths(codes)
        self.depths = len(shifts)
        # Per depth: (n,) the cell of each row, and (cells,) the first row of each cell.
        self.cell: list[I64] = []
        firsts: list[I64] = []
        for shift in shifts:
            new = np.ones(len(codes), np.bool_)
            new[1:] = joining > shift
            self.cell.append(np.cumsum(new) - 1)
            firsts.append(np.flatnonzero(new))
        # Per depth: (cells of the last depth,) the cell around each, and (cells,) the first of each.
        self.parents = [cell[firsts[-1]] for cell in self.cell]
        self.starts = [np.searchsorted(firsts[-1], first) for first in firsts]


class CellSums:
    """Sums per cell over the anchors added so far: the set E of SPEC §10.2, which grows pass by pass.

    Args:
        cells: of a tile-layer.
        columns: values of an anchor.
    """

    def __init__(self, cells: Cells, columns: int) -> None:
        self._cells = cells
        finest = len(cells.starts[-1]) if cells.depths else 0
        self._sums = np.zeros((columns, finest))
        self._counts = np.zeros(finest)

    def add(self, rows: Ints, values: Numbers) -> None:
        """Add anchors, each at most once.

        Args:
            rows: (m,).
            values: (m, columns) integers in -2^24..2^24.
        """
        if not len(self._counts) or not len(rows):
            return
        cell = self._cells.cell[-1][rows]
        for total, column in zip(self._sums, values.T, strict=True):
            total += np.bincount(cell, column, len(total))
        self._counts += np.bincount(cell, minlength=len(self._counts))

    def around(self, wanted: Ints) -> tuple[F64, F64]:
        """Means and counts in the cells of the rows `wanted`, nearest integers with ties up (SPEC §10.2).

        Returns:
            (w, depths, columns) means; where a cell is empty that of the depth before, 0 at the first. And
            (w, depths) counts. Both float64 that carry integers, in any memory order.
        """
        cells = self._cells
        means = np.empty((cells.depths, len(self._sums), len(wanted)))
        counts = np.empty((cells.depths, len(wanted)))
        place = cells.cell[-1][wanted] if cells.depths else wanted
        # Means are kept per finest cell, so that an empty cell finds that of the depth before.
        before = np.zeros(self._sums.shape)
        for depth, (parent, starts) in enumerate(zip(cells.parents, cells.starts, strict=True)):
            sums = np.add.reduceat(self._sums, starts, axis=1) if len(starts) else self._sums
            count = np.add.reduceat(self._counts, starts) if len(starts) else self._counts
            # Below 2^46 over 2^21: a float64 quotient never reaches the next integer.
            here = np.floor((2 * sums + count) / np.maximum(2 * count, 1))
            count = count[parent]
            before = np.where(count > 0, here[:, parent], before)
            # Without bounds checks, for which NumPy would buffer the output.
            np.take(before, place, axis=1, out=means[depth], mode="clip")
            np.take(count, place, out=counts[depth], mode="clip")
        return means.transpose(2, 0, 1), counts.T


def count_features(counts: Numbers) -> F64:
    """32 * min(bit length, 8) of non-negative integers below 2^53 (SPEC §10.2)."""
    lengths = np.frexp(counts)[1]
    return np.asarray(COUNT_UNIT * np.minimum(lengths, COUNT_TOP), np.float64)

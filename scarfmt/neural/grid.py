"""Binarised multi-resolution hash grid: features of an anchor from its lattice position alone (SPEC §10.6).

The spatial embedding of the paper (§3.4, §3.7), as a hybrid of 3D levels, levels on the three coordinate
planes and, beyond the paper, levels along one axis, which cost next to nothing. Every table entry is one bit
a feature, read as -1 or +1; a feature is the multilinear interpolation of the 2^dims vertices of the anchor's
cell, in exact integers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64, I16, I64, U8
from scarfmt.errors import Malformed

MAX_LEVELS = 16
MAX_FEATURES = 8
MAX_RESOLUTION = (1 << 16) - 1
MAX_TABLE_LOG2 = 19
MAX_GRID_BITS = 1 << 24
MAX_EXTENT_BITS = 32
FEATURE_MAX = 127

PLANE_AXES = ((0, 1, 2), (0, 1), (0, 2), (1, 2), (0,), (1,), (2,))
"""Axes a level interpolates along, by its plane: 3D, xy, xz, yz, x, y, z."""

_PRIMES = (1, 2654435761, 805459861)
_FRACTION_BITS = 8
_ONE = 1 << _FRACTION_BITS
# Temporaries of this many anchors fit the second-level cache.
_CHUNK = 8192
# Sums of weights reach 2^24: two of them lie side by side in the 53 bits that binary64 keeps exact.
_LANE_BITS = 26
_LANES = 2


@dataclass(frozen=True)
class GridLevel:
    """One level of a grid.

    Attributes:
        plane: 0 for 3D; 1, 2, 3 for the planes xy, xz, yz; 4, 5, 6 for the axes x, y, z.
        resolution: cells along each axis of the box, 1..65535.
        table_log2: the table has at most 2^table_log2 entries, 1..19.
        features: bits an entry, 1..8.
    """

    plane: int
    resolution: int
    table_log2: int
    features: int

    @property
    def axes(self) -> tuple[int, ...]:
        """The axes it interpolates along."""
        return PLANE_AXES[self.plane]

    @property
    def vertices(self) -> int:
        """Vertices of all its cells."""
        return int((self.resolution + 1) ** len(self.axes))

    @property
    def dense(self) -> bool:
        """Whether every vertex has an entry of its own."""
        return self.vertices <= 1 << self.table_log2

    @property
    def entries(self) -> int:
        """Entries of its table."""
        return self.vertices if self.dense else 1 << self.table_log2

    @property
    def bits(self) -> int:
        """Bits of its table."""
        return self.entries * self.features


@dataclass(frozen=True)
class GridBox:
    """The cube of lattice points that a grid's cells divide; anchors outside are moved to its surface.

    Attributes:
        origin: (3,) lattice coordinates of its lowest corner, below 2^32.
        extent_bits: its side is 2^extent_bits lattice steps, 0..32.
    """

    origin: tuple[int, int, int]
    extent_bits: int

    def inside(self, positions: NDArray[np.integer[Any]]) -> I64:
        """(3, n) int64 coordinates from the origin, 0..2^extent_bits - 1, of (n, 3) lattice `positions` below 2^63."""
        offset = positions.astype(np.int64).T - np.array(self.origin, np.int64)[:, None]
        inside: I64 = np.clip(offset, 0, (1 << self.extent_bits) - 1)
        return inside

    def locate(self, level: GridLevel, inside: I64) -> tuple[I64, I64]:
        """Cells and fractions, (dims, n) int64 each, of (3, n) coordinates from :meth:`inside`.

        Returns:
            The cell along each axis of the level, 0..resolution - 1, and the place in it, 0..255.
        """
        scaled = inside[list(level.axes)] * level.resolution
        spare = self.extent_bits - _FRACTION_BITS
        fine = scaled >> spare if spare >= 0 else scaled << -spare
        return scaled >> self.extent_bits, fine & (_ONE - 1)


def vertex_addresses(level: GridLevel, cells: I64) -> I64:
    """(2^dims, n) int64 table entries of the vertices of (dims, n) `cells`.

    Vertex v is one up along the level's axis d where bit d of v is set.
    """
    if level.dense:
        strides = [(level.resolution + 1) ** d for d in range(len(cells))]
        ends = [(cell * stride, (cell + 1) * stride) for cell, stride in zip(cells, strides, strict=True)]
        return _products(np.add, ends)
    mask = (1 << level.table_log2) - 1
    primes = _PRIMES[: len(cells)]
    # The mask first: XOR keeps bits apart, and the low bits of a product do not depend on its high ones.
    ends = [(cell * prime & mask, (cell + 1) * prime & mask) for cell, prime in zip(cells, primes, strict=True)]
    return _products(np.bitwise_xor, ends)


def vertex_weights(fractions: NDArray[Any]) -> NDArray[Any]:
    """(2^dims, n) weights, summing to 256^dims, of the vertices of the cells that (dims, n) `fractions` lie in."""
    return _products(np.multiply, [(_ONE - fraction, fraction) for fraction in fractions])


def _products(combine: Callable[[Any, Any], Any], ends: list[tuple[Any, Any]]) -> NDArray[Any]:
    """Rows v = 0..2^dims - 1 that combine the first or, where bit d of v is set, the second of each `ends[d]`."""
    rows: NDArray[Any] = np.stack(ends[0])
    for low, high in ends[1:]:
        rows = np.concatenate([combine(rows, low), combine(rows, high)])
    return rows


def check_grid(box: GridBox, levels: tuple[GridLevel, ...]) -> None:
    """Check the shape of a grid, before its bits are read (SPEC §10.6).

    Raises:
        Malformed: ``bad-grid``.
    """
    if not 0 <= box.extent_bits <= MAX_EXTENT_BITS or len(box.origin) != 3:
        raise _bad_grid(f"a box of 2^{box.extent_bits} lattice steps")
    if not all(0 <= origin < 1 << 32 for origin in box.origin):
        raise _bad_grid(f"the box starts at {box.origin}")
    if not 1 <= len(levels) <= MAX_LEVELS:
        raise _bad_grid(f"{len(levels)} levels")
    for level in levels:
        fits = 0 <= level.plane < len(PLANE_AXES) and 1 <= level.resolution <= MAX_RESOLUTION
        if not (fits and 1 <= level.table_log2 <= MAX_TABLE_LOG2 and 1 <= level.features <= MAX_FEATURES):
            raise _bad_grid(f"{level} is out of range")
    total = sum(level.bits for level in levels)
    if total > MAX_GRID_BITS:
        raise _bad_grid(f"{total} bits, at most 2^24 allowed")


def _bad_grid(message: str) -> Malformed:
    return Malformed("bad-grid", f"{message} (SPEC §10.6)", field="grid")


@dataclass(frozen=True)
class HashGrid:
    """A grid and its bits.

    Attributes:
        origin, extent_bits: of the :class:`GridBox` that its cells divide.
        levels: 1..16 levels.
        bits: (entries, features) uint8 of 0 and 1 a level.
    """

    origin: tuple[int, int, int]
    extent_bits: int
    levels: tuple[GridLevel, ...]
    bits: tuple[U8, ...]

    @property
    def box(self) -> GridBox:
        """The box that the cells divide."""
        return GridBox(self.origin, self.extent_bits)

    @property
    def width(self) -> int:
        """Features of an anchor."""
        return sum(level.features for level in self.levels)

    def features(self, positions: NDArray[np.integer[Any]]) -> I16:
        """(n, width) int16 features, -127..127, of anchors at (n, 3) lattice `positions`, level by level.

        Any order of anchors gives the same features; an order in which neighbours follow one another is fastest.
        """
        out, box = np.empty((len(positions), self.width), np.int16), self.box
        for first in range(0, len(positions), _CHUNK):
            inside = box.inside(positions[first : first + _CHUNK])
            column = 0
            for level, words in zip(self.levels, self._words, strict=True):
                part = out[first : first + _CHUNK, column : column + level.features]
                for feature, values in enumerate(_level_features(box, level, words, inside)):
                    part[:, feature] = values
                column += level.features
        return out

    @cached_property
    def _words(self) -> list[F64]:
        """(words, entries) float64 a level: the bits of two features in each word, 26 bits apart."""
        found = []
        for level, bits in zip(self.levels, self.bits, strict=True):
            padded = np.zeros((level.entries, -(-level.features // _LANES) * _LANES), np.int64)
            padded[:, : level.features] = bits
            lanes = 1 << (_LANE_BITS * np.arange(_LANES, dtype=np.int64))
            found.append((padded.reshape(level.entries, -1, _LANES) @ lanes).T.astype(np.float64))
        return found


def _level_features(box: GridBox, level: GridLevel, words: F64, inside: I64) -> Iterator[I64]:
    """(n,) int64 values of each feature of one level at (3, n) coordinates from :meth:`GridBox.inside`."""
    cells, fractions = box.locate(level, inside)
    starts, lengths = _runs(cells)
    addresses = vertex_addresses(level, cells[:, starts])
    weights = vertex_weights(fractions.astype(np.float64))
    for feature in range(level.features):
        word, lane = divmod(feature, _LANES)
        if lane == 0:
            corners = np.repeat(words[word][addresses], lengths, axis=1)
            sums = np.einsum("vn,vn->n", weights, corners).astype(np.int64)
        yield _round(sums >> (_LANE_BITS * lane) & ((1 << _LANE_BITS) - 1), len(level.axes))


def _runs(cells: I64) -> tuple[I64, I64]:
    """Starts and lengths of runs of anchors in the same cell: cheaper than sorting, as anchors come in Morton order."""
    changed = np.any(cells[:, 1:] != cells[:, :-1], axis=0)
    starts = np.concatenate(([0], np.flatnonzero(changed) + 1))
    return starts, np.diff(np.append(starts, cells.shape[1]))


def _round(ones: I64, dims: int) -> I64:
    """Features from the total weight of the vertices whose bit is 1: that of the zeros is the rest of 256^dims."""
    bits = _FRACTION_BITS * dims
    shift = bits - 7
    rounded: I64 = np.clip((2 * ones - (1 << bits) + (1 << (shift - 1))) >> shift, -FEATURE_MAX, FEATURE_MAX)
    return rounded

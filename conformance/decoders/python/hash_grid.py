"""HASH_GRID blocks, and the features of an anchor (SPEC §10.6)."""

from __future__ import annotations

import math
from typing import NamedTuple

from conformance.decoders.python.arithmetic import Vector, clamp, round_shift
from conformance.decoders.python.fields import Payload, Rans, Table, cumulative, require

PLANES = ((0, 1, 2), (0, 1), (0, 2), (1, 2), (0,), (1,), (2,))
PRIMES = (1, 2654435761, 805459861)


class Level(NamedTuple):
    """One level of a hash grid."""

    axes: tuple[int, ...]
    resolution: int
    table_log2: int
    features: int

    @property
    def vertices(self) -> int:
        return math.prod([self.resolution + 1] * len(self.axes))

    @property
    def dense(self) -> bool:
        return self.vertices <= 1 << self.table_log2

    @property
    def entries(self) -> int:
        return self.vertices if self.dense else 1 << self.table_log2

    def entry(self, vertex: Vector) -> int:
        if self.dense:
            return sum(n * (self.resolution + 1) ** d for d, n in enumerate(vertex))
        hashed = 0
        for n, prime in zip(vertex, PRIMES, strict=False):
            hashed ^= n * prime
        return hashed % (1 << self.table_log2)


class Grid(NamedTuple):
    """A HASH_GRID block."""

    origin: Vector
    extent_bits: int
    levels: list[tuple[Level, Vector]]

    def features(self, point: Vector) -> Vector:
        """The features of an anchor whose cell has this middle, in lattice steps."""
        k, out = self.extent_bits, []
        q = [clamp(p - o, 0, (1 << k) - 1) for p, o in zip(point, self.origin, strict=True)]
        for level, bits in self.levels:
            x = [q[axis] * level.resolution for axis in level.axes]
            cell = [v >> k for v in x]
            part = [(v >> (k - 8) if k >= 8 else v << (8 - k)) & 255 for v in x]
            sums = [0] * level.features
            for corner in range(1 << len(x)):
                up = [corner >> d & 1 for d in range(len(x))]
                weight = math.prod(f if u else 256 - f for f, u in zip(part, up, strict=True))
                start = level.entry([c + u for c, u in zip(cell, up, strict=True)]) * level.features
                for feature, bit in enumerate(bits[start : start + level.features]):
                    sums[feature] += weight if bit else -weight
            out += [clamp(round_shift(s, 8 * len(x) - 7), -127, 127) for s in sums]
        return out


def parse_grid(block: bytes) -> Grid:
    reader = Payload(block)
    *origin, extent_bits, count = reader.fields("3I2B")
    shapes = [reader.fields("BIBB") for _ in range(count)]
    most = (len(PLANES) - 1, 65535, 19, 8)
    fits = all(a <= b for shape in shapes for a, b in zip(shape, most, strict=True))
    least = all(min(shape[1:]) >= 1 for shape in shapes)
    require(extent_bits <= 32 and 1 <= count <= 16 and fits and least, "bad-grid")
    bits = sum(level.entries * level.features for level in (Level(PLANES[plane], *shape) for plane, *shape in shapes))
    require(bits <= 1 << 24, "bad-grid")
    levels = []
    for plane, *shape in shapes:
        level = Level(PLANES[plane], *shape)
        ones = reader.u8()
        require(ones > 0, "bad-grid")
        rans = Rans(reader.take(reader.fields("I")[0]), {})
        table = Table((0, 1), cumulative([256 - ones, ones]))
        levels.append((level, [rans.symbol(table) for _ in range(level.entries * level.features)]))
        rans.seal()
    reader.finish()
    return Grid(origin, extent_bits, levels)

"""The anchors known in a layer of a tile, their passes, and sums of decoded values around them (SPEC §10.2)."""

from __future__ import annotations

from collections.abc import Sequence

from conformance.decoders.python.arithmetic import Matrix, Vector, clamp


def fine(v: int, n: int) -> int:
    if n == 0:
        return 0
    power: int = 3 ** (n - 1)
    return clamp((2048 * v + power) // (2 * power), -(1 << 24), 1 << 24)


class Context:
    """The anchors known in one layer of one tile, and how they are summed up."""

    def __init__(self, codes: Vector, bits: int, targets: Sequence[int], passes_log2: int) -> None:
        self.codes = codes
        self.rank = {a: r for r, a in enumerate(sorted(range(len(codes)), key=lambda a: (codes[a], a)))}
        self.passes_log2 = passes_log2
        self.depths = [self._depth(bits, t) for t in targets]

    def _depth(self, bits: int, target: int) -> int:
        for e in range(bits):
            if len({code >> 3 * e for code in self.codes}) * target <= len(self.codes):
                return e
        return bits

    def passes(self, group: Vector) -> list[Vector]:
        group = sorted(group, key=self.rank.__getitem__)
        p = 1 << self.passes_log2
        out = [group[::p]]
        while p > 1:
            out.append(group[p // 2 :: p])
            p //= 2
        return out

    def cells(self, columns: int) -> Cells:
        return Cells(self, columns)


class Cells:
    """The collection E: sums of its rows in every cell of every depth."""

    def __init__(self, context: Context, columns: int) -> None:
        self.context = context
        self.columns = columns
        self.sums: list[dict[int, tuple[int, Vector]]] = [{} for _ in context.depths]

    def add(self, a: int, row: Vector) -> None:
        for e, cells in zip(self.context.depths, self.sums, strict=True):
            cell = self.context.codes[a] >> 3 * e
            n, sums = cells.get(cell, (0, [0] * self.columns))
            cells[cell] = n + 1, [s + v for s, v in zip(sums, row, strict=True)]

    def around(self, a: int) -> tuple[Matrix, Vector]:
        means, counts = [], []
        before = [0] * self.columns
        for e, cells in zip(self.context.depths, self.sums, strict=True):
            n, sums = cells.get(self.context.codes[a] >> 3 * e, (0, []))
            if n > 0:
                before = [(2 * s + n) // (2 * n) for s in sums]
            means.append(before)
            counts.append(32 * min(n.bit_length(), 8))
        return means, counts

"""Positions of the anchors that appear in a layer of a tile (SPEC §7.2)."""

from __future__ import annotations

from conformance.decoders.python.fields import POSITIONS, Rans, key, require


def read_positions(rans: Rans, total: int, b: int) -> list[int]:
    code, opened = [0] * total, [0] * total
    nodes = [(0, total, 0)]
    for bit in range(3 * b - 1, -1, -1):
        several = []
        for start, count, prefix in nodes:
            if count == 1:
                opened[start], code[start] = bit + 1, prefix
            else:
                several.append((start, count, prefix))
        nodes = several
        if not nodes:
            break
        lower = read_splits(rans, [count for _, count, _ in nodes])
        children = []
        for (start, count, prefix), below in zip(nodes, lower, strict=True):
            if below > 0:
                children.append((start, below, prefix))
            if count - below > 0:
                children.append((start + below, count - below, prefix | 1 << bit))
        nodes = children
    for start, count, prefix in nodes:
        code[start : start + count] = [prefix] * count
    for width in range(3 * b, 0, -1):
        anchors = [a for a in range(total) if opened[a] == width]
        for low in range(12 * ((width - 1) // 12), -1, -12):
            for a, bits in zip(anchors, rans.uniform(1 << min(12, width - low), len(anchors)), strict=True):
                code[a] |= bits << low
    return code


def read_splits(rans: Rans, counts: list[int]) -> list[int]:
    lower = [0] * len(counts)
    for n in range(2, 17):
        chosen = [i for i, count in enumerate(counts) if count == n]
        for i, value in zip(chosen, rans.read(key(POSITIONS, 0, 0, n), len(chosen)), strict=True):
            lower[i] = value
    large = [i for i, count in enumerate(counts) if count > 16]
    bins = rans.read(key(POSITIONS, 0, 0, 17), len(large))
    require(all(0 <= bin_ < 16 for bin_ in bins), "bad-split")
    first = [-(-bin_ * (counts[i] + 1) // 16) for i, bin_ in zip(large, bins, strict=True)]
    width = [-(-(bin_ + 1) * (counts[i] + 1) // 16) - f for i, bin_, f in zip(large, bins, first, strict=True)]
    rest = [0] * len(large)
    for w in sorted({w for w in width if w > 1}):
        chosen = [m for m, here in enumerate(width) if here == w]
        if w <= 4096:
            values = rans.uniform(w, len(chosen))
        else:
            high = rans.uniform(((w - 1) >> 12) + 1, len(chosen))
            values = [h << 12 | v for h, v in zip(high, rans.uniform(4096, len(chosen)), strict=True)]
        for m, value in zip(chosen, values, strict=True):
            require(value < w, "bad-split")
            rest[m] = value
    for m, i in enumerate(large):
        lower[i] = first[m] + rest[m]
    require(all(0 <= below <= count for below, count in zip(lower, counts, strict=True)), "bad-split")
    return lower

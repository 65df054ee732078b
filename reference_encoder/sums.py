"""Sums of binary32 numbers in one order of additions: the same bits on every machine and with every library.

The order is that of torch 2 on a processor with lanes of 32 bytes. Files that were written when these sums were torch's
are written again to the byte; a test compares the two where torch is there.
"""

from __future__ import annotations

import numpy as np

from reference_encoder.jit import compiled
from scarfmt.arrays import F32, I64

_LANES, _SHARES = 8, 4
_LEVELS, _LEAST_POWER = 4, 4


@compiled
def row_sums(values: F32) -> F32:
    """(n,) float32 sums of the rows of (n, d) `values`: of each of eight lanes four shares, then all lanes."""
    out = np.empty(len(values), np.float32)
    width = _LANES if values.shape[1] >= _LANES else 1
    size = values.shape[1] // width
    whole = size // _SHARES
    levels = np.empty((_LEVELS, _SHARES * width), np.float32)
    shares = levels[0]
    for number in range(len(values)):
        row, total = values[number], np.float32(0)
        _add_levelled(row, whole, levels)
        for place in range(_SHARES * whole * width, size * width, width):
            for lane in range(width):
                shares[lane] += row[place + lane]
        for place in range(size * width, len(row)):
            total += row[place]
        for lane in range(width):
            part = shares[lane]
            for share in range(1, _SHARES):
                part += shares[share * width + lane]
            total += part
        out[number] = total
    return out


@compiled
def _add_levelled(row: F32, count: int, levels: F32) -> None:
    """Fill `levels[0]` (k,) with sums of the first `count` runs of k values: by sixteens, by those, and so on."""
    wide, depth = levels.shape[1], 0
    while 1 << depth < count:
        depth += 1
    power = max(_LEAST_POWER, depth // _LEVELS)
    levels[:] = 0
    for run in range(1, count + 1):
        start = (run - 1) * wide
        for k in range(wide):
            levels[0, k] += row[start + k]
        done = run & ((1 << power) - 1) == 0
        level = 1
        while done and level < _LEVELS:
            for k in range(wide):
                levels[level, k] += levels[level - 1, k]
                levels[level - 1, k] = 0
            done = run & (((1 << power) - 1) << (level * power)) == 0
            level += 1
    for level in range(1, _LEVELS):
        for k in range(wide):
            levels[0, k] += levels[level, k]


@compiled
def squared_lengths(vectors: F32) -> F32:
    """(n,) float32 sums of the squares of the rows of (n, d) `vectors`."""
    return row_sums(vectors * vectors)


@compiled
def added_rows(places: I64, rows: F32, count: int) -> F32:
    """(count, d) float32 sums of those of (n, d) `rows` that share a place, (n,) `places`, one after another."""
    out = np.zeros((count, rows.shape[1]), np.float32)
    for number in range(len(rows)):
        into = out[places[number]]
        for column in range(len(into)):
            into[column] += rows[number, column]
    return out


@compiled
def subtract_rows(rows: F32, places: I64, book: F32, codes: I64) -> None:
    """Subtract codewords (n,) `codes` of (k, d) `book` from those of (m, d) `rows` at (n,) `places`."""
    for number in range(len(places)):
        row, word = rows[places[number]], book[codes[number]]
        for column in range(len(row)):
            row[column] -= word[column]

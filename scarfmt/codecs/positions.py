"""Positions sub-stream: the counts of a binary split of the tile's cube (SPEC §7.2).

The cube of 2^b cells an axis is halved along z, then y, then x, then z again, ...: bit by bit of the
Morton code from the top. A node of n >= 2 anchors codes how many fall into its lower half, with one table
per n; a node of one anchor codes its remaining bits as uniform bits, all at once. Only about 1.6 coded
symbols an anchor are left, and duplicates need no special case: they are a leaf with n > 1.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I64, U64
from scarfmt.container.schema import Stream
from scarfmt.entropy.emitters import Emitter
from scarfmt.entropy.keys import StepKey, TableKey
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.errors import Malformed

T = TypeVar("T", bound=np.generic)

# Nodes of up to this many anchors have a table of their own; larger ones share one over 16 bins.
LARGEST_OWN_TABLE = 16
_BINS = 16
_BIT_CHUNK = 12
# So few nodes are split faster one by one.
_FEW_NODES = 4


KEY = StepKey(Stream.POSITIONS, (0,), 0)
"""Names the tables of splits; a kind is a number of anchors, up to LARGEST_OWN_TABLE + 1."""


_TABLES = TableKey(Stream.POSITIONS, 0, 0, 0)


def _key(count: int) -> TableKey:
    return TableKey(Stream.POSITIONS, 0, 0, min(count, LARGEST_OWN_TABLE + 1))


def _bin_edges(counts: I64, bins: I64) -> I64:
    """Smallest lower-half count in each bin: ceil(bin * (n + 1) / 16)."""
    return -(-bins * (counts + 1) // _BINS)


def _pairs(lower: NDArray[T], upper: NDArray[T]) -> NDArray[T]:
    """(2n,): what belongs to the lower and the upper half of each node, in turn."""
    out = np.empty((len(lower), 2), lower.dtype)
    out[:, 0], out[:, 1] = lower, upper
    return out.ravel()


def _children(start: I64, count: I64, lower: I64) -> tuple[I64, I64, I64]:
    """Child nodes that are not empty: start, count, and number 2 * parent + half; in Morton order."""
    counts = _pairs(lower, count - lower)
    kept = np.flatnonzero(counts)
    return _pairs(start, start + lower)[kept], counts[kept], kept


def put_positions(emitter: Emitter, codes: U64, bits: int) -> None:
    """Emit the sorted Morton codes of one tile's new anchors.

    Args:
        codes: (n,) uint64, ascending, each below 2^(3 * bits).
        bits: local bits per axis, 0..21.
    """
    places = np.concatenate([[True], codes[1:] != codes[:-1], [True]]).nonzero()[0] if len(codes) else _NONE
    different, sizes = codes[places[:-1]], np.diff(places)
    # The bits at which neighbours part, those at both ends from what is outside the cube.
    parting = np.full(len(places), 3 * bits)
    parting[1:-1] = _highest_bit(different[1:] ^ different[:-1])
    least = np.minimum(parting[:-1], parting[1:])
    level, count, lower = _nodes(different, places, parting, least)
    large = count > LARGEST_OWN_TABLE
    bins = lower * _BINS // (count + 1)
    contexts, symbols = np.where(large, LARGEST_OWN_TABLE + 1, count).astype(np.uint8), np.where(large, bins, lower)
    rests = lower - _bin_edges(count, bins)
    widths = np.where(large, _bin_edges(count, bins + 1) - _bin_edges(count, bins), 0)
    ends = np.cumsum(np.bincount(3 * bits - 1 - level, minlength=1)).tolist()
    for start, past in pairwise([0, *ends]):
        if start == past:
            continue
        emitter.emit_by_context(_TABLES, contexts[start:past], symbols[start:past])
        here = widths[start:past]
        for size in np.unique(here[here > 1]).tolist():
            _put_uniform(emitter, size, rests[start:past][here == size])
    alone = np.flatnonzero(sizes == 1)
    alone = alone[np.argsort(-least[alone], kind="stable")]
    for first, past in pairwise([*np.flatnonzero(np.diff(least[alone], prepend=-1)).tolist(), len(alone)]):
        _put_bits(emitter, different[alone[first:past]], int(least[alone[first]]))


_NONE = np.zeros(0, np.int64)


def _nodes(codes: U64, places: I64, parting: I64, least: I64) -> tuple[I64, I64, I64]:
    """Level, number of anchors, and how many of them are in the lower half, of nodes of two or more, as they travel.

    Args:
        codes: (m,) different codes, ascending.
        places: (m + 1,) first anchor of each, and one past the last.
        parting: (m + 1,) bits at which neighbours part.
        least: (m,) number of bits below that at which a code parts from the nearest other one.
    """
    inner, several = np.arange(1, len(codes)), np.flatnonzero(np.diff(places) > 1)
    before, after = _nearest_larger(parting)[1:-1], len(codes) - _nearest_larger(parting[::-1])[-2:0:-1]
    # What stays together above the bit where it parts, and what never parts.
    top = np.concatenate([np.minimum(parting[before], parting[after]), least[several]])
    bottom = np.concatenate([parting[inner], np.full(len(several), -1)])
    first, past = np.concatenate([before, several]), np.concatenate([after, several + 1])
    middle = np.concatenate([inner, several])
    lengths = top - np.maximum(bottom, 0)
    order = np.argsort(first, kind="stable")
    node, starts = np.repeat(order, lengths[order]), np.cumsum(lengths[order]) - lengths[order]
    level = top[node] - 1 - np.arange(len(node)) + np.repeat(starts, lengths[order])
    travel = np.argsort((63 - level).astype(np.uint8), kind="stable")
    node, level = node[travel], level[travel]
    count = places[past[node]] - places[first[node]]
    below = np.where((codes[first[node]] >> level.astype(np.uint64)) & np.uint64(1), 0, count)
    return level, count, np.where(level == bottom[node], places[middle[node]] - places[first[node]], below)


def _nearest_larger(numbers: I64) -> I64:
    """(n,) place of the last larger number before each; none before the first, and no larger one than it."""
    place = np.maximum(np.arange(len(numbers)) - 1, 0)
    short = np.arange(1, len(numbers))
    while len(short):
        short = short[numbers[place[short]] < numbers[short]]
        place[short] = place[place[short]]
    return place


def _highest_bit(numbers: U64) -> I64:
    """(n,) number of the highest bit of each, none 0."""
    upper = (numbers >> np.uint64(32)).astype(np.float64)
    lower = (numbers & np.uint64(0xFFFFFFFF)).astype(np.float64)
    return np.where(upper > 0, np.frexp(upper)[1] + 31, np.frexp(lower)[1] - 1)


def _put_uniform(emitter: Emitter, size: int, values: I64) -> None:
    """A uniform value below `size`; sizes above 4096 as high part, then low 12 bits."""
    if size <= 1 << _BIT_CHUNK:
        emitter.emit_uniform(size, values)
        return
    emitter.emit_uniform(((size - 1) >> _BIT_CHUNK) + 1, values >> _BIT_CHUNK)
    emitter.emit_uniform(1 << _BIT_CHUNK, values & ((1 << _BIT_CHUNK) - 1))


def _put_bits(emitter: Emitter, codes: U64, width: int) -> None:
    for low in range(_BIT_CHUNK * ((width - 1) // _BIT_CHUNK), -1, -_BIT_CHUNK):
        size = 1 << min(_BIT_CHUNK, width - low)
        emitter.emit_uniform(size, ((codes >> np.uint64(low)) & np.uint64(size - 1)).astype(np.int64))


def get_positions(reader: SymbolReader, total: int, bits: int) -> U64:
    """Read what :func:`put_positions` emitted: (total,) uint64 Morton codes, ascending.

    Raises:
        Malformed: ``bad-split`` when a split count exceeds its node's.
    """
    codes = np.zeros(total, np.uint64)
    start, count = np.zeros(1, np.int64), np.array([total], np.int64)
    start, count = start[count > 0], count[count > 0]
    # Bits left to read of each anchor that is alone in its node.
    open_bits = np.zeros(total, np.uint8)
    prefix = np.zeros(len(start), np.uint64)
    for bit in range(3 * bits - 1, -1, -1):
        alone = count == 1
        singles = start[alone]
        open_bits[singles] = bit + 1
        codes[singles] = prefix[alone]
        several = np.flatnonzero(~alone)
        if not len(several):
            start, count, prefix = start[:0], count[:0], prefix[:0]
            break
        start, count, prefix = start[several], count[several], prefix[several]
        if len(several) <= _FEW_NODES:
            start, count, prefix = _few_children(reader, start, count, prefix, bit)
            continue
        lower = _get_splits(reader, count)
        upper = prefix | (np.uint64(1) << np.uint64(bit))
        start, count, kept = _children(start, count, lower)
        prefix = _pairs(prefix, upper)[kept]
    for first, n, code in zip(start[count > 1], count[count > 1], prefix[count > 1], strict=True):
        codes[first : first + n] = code
    codes[start[count == 1]] = prefix[count == 1]
    order = np.argsort(open_bits, kind="stable")
    ends = np.cumsum(np.bincount(open_bits, minlength=3 * bits + 1)).tolist()
    for width in range(3 * bits, 0, -1):
        chosen = order[ends[width - 1] : ends[width]]
        if len(chosen):
            codes[chosen] |= _get_bits(reader, len(chosen), width)
    return codes


def _few_children(reader: SymbolReader, start: I64, count: I64, prefix: U64, bit: int) -> tuple[I64, I64, U64]:
    """The children of a few nodes, one by one: duplicates go down all levels alone, where arrays would cost most."""
    counts = count.tolist()
    lower = _few_splits(reader, counts)
    nodes = []
    for first, n, code, below in zip(start.tolist(), counts, prefix.tolist(), lower, strict=True):
        if below:
            nodes.append((first, below, code))
        if n > below:
            nodes.append((first + below, n - below, code | 1 << bit))
    starts, left, codes = zip(*nodes, strict=True)
    return np.array(starts, np.int64), np.array(left, np.int64), np.array(codes, np.uint64)


def _few_splits(reader: SymbolReader, counts: list[int]) -> list[int]:
    """Counts of the lower halves of nodes of 17 anchors or more: bin, then the rest in uniform symbols (SPEC §7.2)."""
    if max(counts) > LARGEST_OWN_TABLE:
        return list(map(int, _get_splits(reader, np.array(counts, np.int64))))
    lower = [0] * len(counts)
    for n in sorted(set(counts)):
        nodes = [node for node, size in enumerate(counts) if size == n]
        for node, below in zip(nodes, reader.read(_key(n), len(nodes)).tolist(), strict=True):
            lower[node] = below
    if any(not 0 <= below <= n for below, n in zip(lower, counts, strict=True)):
        raise _bad_split("a split puts more anchors below than the node holds")
    return lower


def _bad_split(what: str) -> Malformed:
    return Malformed("bad-split", f"{what} (SPEC §7.2)", field="positions")


def _get_splits(reader: SymbolReader, count: I64) -> I64:
    lower = np.zeros(len(count), np.int64)
    few = count <= LARGEST_OWN_TABLE
    small, large = np.flatnonzero(few), np.flatnonzero(~few)
    lower[small] = reader.read_grouped(KEY, count[small])
    if len(large):
        lower[large] = _get_large_splits(reader, count[large])
    if bool(((lower < 0) | (lower > count)).any()):
        raise _bad_split("a split puts more anchors below than the node holds")
    return lower


def _get_large_splits(reader: SymbolReader, count: I64) -> I64:
    bins = reader.read(_key(LARGEST_OWN_TABLE + 1), len(count))
    if int(bins.min()) < 0 or int(bins.max()) >= _BINS:
        raise _bad_split("a split bin is not in 0..15")
    first = _bin_edges(count, bins)
    widths = _bin_edges(count, bins + 1) - first
    rest = np.zeros(len(count), np.int64)
    for size in np.unique(widths[widths > 1]):
        chosen = widths == size
        rest[chosen] = _get_uniform(reader, int(size), int(chosen.sum()))
    return first + rest


def _get_uniform(reader: SymbolReader, size: int, count: int) -> I64:
    if size <= 1 << _BIT_CHUNK:
        return reader.read_uniform(size, count)
    high = reader.read_uniform(((size - 1) >> _BIT_CHUNK) + 1, count)
    value = (high << _BIT_CHUNK) | reader.read_uniform(1 << _BIT_CHUNK, count)
    if bool((value >= size).any()):
        raise _bad_split("a uniform remainder is out of range")
    return value


def _get_bits(reader: SymbolReader, count: int, width: int) -> U64:
    codes = np.zeros(count, np.uint64)
    for low in range(_BIT_CHUNK * ((width - 1) // _BIT_CHUNK), -1, -_BIT_CHUNK):
        size = 1 << min(_BIT_CHUNK, width - low)
        codes |= reader.read_uniform(size, count).astype(np.uint64) << np.uint64(low)
    return codes

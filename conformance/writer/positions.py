"""POSITIONS: local codes as counts of a binary split (SPEC §7.2)."""

from __future__ import annotations

from bisect import bisect_left
from typing import NamedTuple

from conformance.decoders.python.fields import POSITIONS, key
from conformance.writer.substream import Substream

SPLITS, SMALL, BINS = 16, 12, 16
"""Counts up to SPLITS have a table each; so many bits of a number are uniform at a time; BINS of large splits."""


class _Node(NamedTuple):
    start: int
    anchors: int
    prefix: int


def put_positions(out: Substream, codes: list[int], bits: int) -> None:
    """The local codes of the anchors that appear, not descending, of a tile of `bits` local bits an axis."""
    nodes = [_Node(0, len(codes), 0)] if codes else []
    alone: dict[int, list[int]] = {}
    for bit in range(3 * bits - 1, -1, -1):
        alone[bit + 1] = [node.start for node in nodes if node.anchors == 1]
        nodes = [node for node in nodes if node.anchors > 1]
        if not nodes:
            break
        lower = [_lower(codes, node, bit) for node in nodes]
        _put_splits(out, [node.anchors for node in nodes], lower)
        nodes = [child for node, below in zip(nodes, lower, strict=True) for child in _children(node, below, bit)]
    for width in sorted(alone, reverse=True):
        _put_rest(out, [codes[a] for a in alone[width]], width)


def _lower(codes: list[int], node: _Node, bit: int) -> int:
    past = node.start + node.anchors
    return bisect_left(codes, node.prefix | 1 << bit, node.start, past) - node.start


def _children(node: _Node, below: int, bit: int) -> list[_Node]:
    lower = _Node(node.start, below, node.prefix)
    upper = _Node(node.start + below, node.anchors - below, node.prefix | 1 << bit)
    return [child for child in (lower, upper) if child.anchors]


def _put_rest(out: Substream, codes: list[int], width: int) -> None:
    """The low `width` bits of codes, the top part first."""
    for low in range(SMALL * ((width - 1) // SMALL), -1, -SMALL):
        size = 1 << min(SMALL, width - low)
        out.put_uniform(size, [code >> low & (size - 1) for code in codes])


def _put_splits(out: Substream, counts: list[int], lower: list[int]) -> None:
    for n in range(2, SPLITS + 1):
        out.put(key(POSITIONS, 0, 0, n), [below for count, below in zip(counts, lower, strict=True) if count == n])
    large = [(count, below) for count, below in zip(counts, lower, strict=True) if count > SPLITS]
    out.put(key(POSITIONS, 0, 0, SPLITS + 1), [below * BINS // (count + 1) for count, below in large])
    rests: dict[int, list[int]] = {}
    for count, below in large:
        bin_ = below * BINS // (count + 1)
        first, past = (-(-edge * (count + 1) // BINS) for edge in (bin_, bin_ + 1))
        rests.setdefault(past - first, []).append(below - first)
    for width in sorted(rests):
        if width > 1:
            _put_below(out, width, rests[width])


def _put_below(out: Substream, width: int, rests: list[int]) -> None:
    if width <= 1 << SMALL:
        out.put_uniform(width, rests)
        return
    out.put_uniform((width - 1 >> SMALL) + 1, [rest >> SMALL for rest in rests])
    out.put_uniform(1 << SMALL, [rest & ((1 << SMALL) - 1) for rest in rests])

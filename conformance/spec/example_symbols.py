"""Worked examples of SPEC.md §7 and §8: splits, positions, masks, contexts, keys, frequencies, rANS.

Streams are coded by the suite's writer and read by the second decoder, which is watched as it reads.
"""

from __future__ import annotations

import struct
from itertools import pairwise
from typing import NamedTuple

from conformance.decoders.python.fields import POSITIONS, Rans, Table, cumulative, key
from conformance.decoders.python.models import Channel, Rule
from conformance.decoders.python.positions import read_positions
from conformance.decoders.python.tile import Tile, read_masks, table_contexts
from conformance.writer import entropy
from conformance.writer.positions import BINS, SPLITS, put_positions
from conformance.writer.substream import Substream

SPLIT, WIDE_SPLIT = (40, 23), (65536, 4096)
"""Anchors of a node, and how many of them are in its lower half."""
CODES, LOCAL_BITS = [15, 234], 3
ON_BEFORE = ((False, True, False), (False, False, False))
TURNED_ON = ((True, False, False), (False, False, True))
WEIGHTS, SYMBOLS = [1, 2, 1], [1, 0, 2]
KEY = (5, 1, 2, 35)
"""Stream SCALE, component, step, context."""
CLASS, SOURCE, RULE = 2, 9, Rule(by_class=1, source_channel=0, source_component=0, shift=1, low=-4)
REFINED = (-7, -2, -1, 0, 5)


class Asked(NamedTuple):
    """A group of a POSITIONS stream: the context of its table, or the size of its uniform table, and its values."""

    uniform: bool
    number: int
    values: list[int]


class _Watched(Rans):
    """A stream that keeps what was read of it."""

    def __init__(self, data: bytes, tables: dict[int, Table]) -> None:
        super().__init__(data, tables)
        self.asked: list[Asked] = []

    def read(self, number: int, n: int) -> list[int]:
        values = super().read(number, n)
        if n:
            self.asked.append(Asked(False, number & 0xFF, values))
        return values

    def uniform(self, m: int, n: int) -> list[int]:
        values = super().uniform(m, n)
        if n:
            self.asked.append(Asked(True, m, values))
        return values


class _Answering(Rans):
    """A stream of known symbols that keeps the contexts they are asked for with."""

    def __init__(self, answers: list[list[int]]) -> None:
        super().__init__(b"", {})
        self._answers = iter(answers)
        self.asked: list[tuple[list[int], list[int]]] = []

    def read_by_context(self, number: int, contexts: list[int]) -> list[int]:
        answers = next(self._answers)
        self.asked.append((contexts, answers))
        return answers


def tree(codes: list[int], bits: int) -> list[Asked]:
    """The groups in which anchors of these local codes are read back (SPEC §7.2)."""
    sizes = {n: n + 1 for n in range(2, SPLITS + 1)} | {SPLITS + 1: BINS}
    tables = {key(POSITIONS, 0, 0, n): entropy.Table(tuple(range(m)), (1,) * m) for n, m in sizes.items()}
    out = Substream()
    put_positions(out, codes, bits)
    plain = {number: Table(table.values, cumulative(list(table.weights))) for number, table in tables.items()}
    stream = _Watched(out.code(tables), plain)
    if read_positions(stream, len(codes), bits) != codes:
        raise ValueError(f"{codes} do not come back")
    return stream.asked


def split(anchors: int, lower: int) -> list[Asked]:
    """The groups of one node of more than 16 anchors, so many in its lower half: bin, then rest."""
    asked = tree([0] * lower + [4] * (anchors - lower), 1)
    others = [i for i, group in enumerate(asked) if i and not group.uniform]
    return asked[: others[0]]


def masks() -> list[tuple[list[int], list[int]]]:
    """Contexts and symbols of MASKS, slot by slot (SPEC §7.4)."""
    tile = Tile(len(ON_BEFORE[0]), [])
    for slots in ON_BEFORE:
        tile.append(0, 0)
        tile.slot_layer[-1] = [int(on) for on in slots]
    answers = []
    for s in range(tile.slots):
        answers.append([int(now[s]) for now, before in zip(TURNED_ON, ON_BEFORE, strict=True) if not before[s]])
    stream = _Answering(answers)
    read_masks(stream, tile, 2)
    return stream.asked


def first_context() -> int:
    """The context of a first step (SPEC §8.4) whose source is v_1 = SOURCE."""
    tile = _tile([Channel(5, [1.0], [RULE]), Channel(6, [1.0], [RULE])])
    tile.first[0][0][0] = SOURCE
    return table_contexts(tile, 1, 0, 1, [0])[0]


def trit_contexts() -> list[int]:
    """The contexts of a later step, of each value to be refined (SPEC §8.4)."""
    tile = _tile([Channel(5, [1.0], [RULE])])
    out = []
    for v in REFINED:
        tile.v[0][0][0] = v
        out += table_contexts(tile, 0, 0, 2, [0])
    return out


def _tile(channels: list[Channel]) -> Tile:
    tile = Tile(1, channels)
    tile.append(0, CLASS)
    return tile


def states() -> tuple[list[int], list[int]]:
    """The words of SYMBOLS, coded with the table of WEIGHTS, and the states before each and at the end (SPEC §8.2)."""
    spans = [(low, past - low) for low, past in pairwise(entropy.cumulative(WEIGHTS))]
    data = entropy.rans([spans[s] for s in SYMBOLS])
    stream, table = Rans(data, {}), Table(range(len(WEIGHTS)), cumulative(WEIGHTS))
    seen = [stream.state]
    for wanted in SYMBOLS:
        if stream.symbol(table) != wanted:
            raise ValueError(f"{SYMBOLS} do not come back")
        seen.append(stream.state)
    stream.seal()
    return list(struct.unpack(f"<{len(data) // 4}I", data)), seen

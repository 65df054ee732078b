"""A TILE block, what is decoded of a tile, and the sub-streams without networks (SPEC §7.1 to §7.5, §8.4)."""

from __future__ import annotations

import itertools
import zlib
from typing import Any

from conformance.decoders.python.fields import OFFSETS, Payload, Table, require
from conformance.decoders.python.models import Channel

Key = tuple[int, int, int]
"""Stream, component and step."""

NAMES = {
    1: "POSITIONS", 2: "CLASSES", 3: "MASKS", 4: "POSITION_RESIDUAL", 5: "SCALE", 6: "ROTATION", 7: "OPACITY",
    8: "COLOUR", 9: "INDICES", 10: "LATENT", 11: "OFFSETS",
}


class Tile:
    """One tile and what is decoded of it so far."""

    def __init__(self, slots: int, channels: list[Channel]) -> None:
        self.code: list[int] = []
        self.klass: list[int] = []
        self.slot_layer: list[list[int]] = []
        self.v: list[list[Any]] = [[] for _ in channels]
        self.index: list[list[int]] = []
        self.slots = slots
        self.channels = channels

    def append(self, code: int, klass: int) -> None:
        self.code.append(code)
        self.klass.append(klass)
        self.slot_layer.append([0] * self.slots)
        self.index.append([0] * 9)
        for i, channel in enumerate(self.channels):
            zeros = [0] * channel.components
            self.v[i].append([list(zeros) for _ in range(self.slots)] if channel.stream == OFFSETS else list(zeros))


class Trace:
    """Intermediate values of decoding one layer, for the stages ``context`` and ``frequencies`` of PROTOCOL.md.

    Attributes:
        frequencies: of the table of the first symbol of a sub-stream, or of a stage, by its name.
        contexts: the context numbers of each predictor, in coding order.
        embedded: h of each anchor that the index network coded, in coding order.
        used: keys of the tables that coded symbols.
        unwritten: whether a sub-stream without a record coded symbols.
    """

    def __init__(self) -> None:
        self.frequencies: dict[str, list[int]] = {}
        self.contexts: dict[Key, list[int]] = {}
        self.embedded: list[list[int]] = []
        self.used: set[int] = set()
        self.unwritten = False

    def see(self, name: str, table: Table | None) -> None:
        if table and name not in self.frequencies:
            self.frequencies[name] = [b - a for a, b in itertools.pairwise(table.cumulative)]


def substreams(block: bytes, kinds: set[int]) -> dict[int, bytes]:
    """The sub-streams of a TILE block of a file that has these kinds (SPEC §7.1)."""
    table = 1 + 9 * block[0]
    require(block[0] <= 11 and table + 4 <= len(block), "bad-substream-table")
    reader = Payload(block)
    records = [reader.fields("BII") for _ in range(reader.u8())]
    (crc,) = reader.fields("I")
    require(crc == zlib.crc32(block[:table]), "crc-mismatch")
    found, lengths = [kind for kind, _, _ in records], [length for _, length, _ in records]
    ascend = all(a < b for a, b in itertools.pairwise([0, *found, 12]))
    whole = all(length > 0 and length % 4 == 0 for length in lengths) and table + 4 + sum(lengths) == len(block)
    require(ascend and whole and set(found) <= kinds, "bad-substream-table")
    out = {}
    for kind, length, part_crc in records:
        out[kind] = reader.take(length)
        require(zlib.crc32(out[kind]) == part_crc, "crc-mismatch")
    return out


def table_contexts(tile: Tile, i: int, j: int, n: int, chosen: list[int]) -> list[int]:
    """The contexts of a channel without predictors (SPEC §8.4)."""
    return [0 if n == 1 else min(max(tile.v[i][a][j], -2), 2) + 2 for a in chosen]

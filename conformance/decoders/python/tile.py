"""A TILE block, what is decoded of a tile, and the sub-streams without networks (SPEC §7.1 to §7.5, §8.4)."""

from __future__ import annotations

import itertools
import zlib
from typing import Any

from conformance.decoders.python.fields import (
    MASKS,
    OFFSETS,
    Payload,
    Rans,
    Table,
    key,
    require,
)
from conformance.decoders.python.models import Channel
from conformance.decoders.python.predictors import Key

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
        self.first: list[list[list[int]]] = [[] for _ in channels]
        self.index: list[list[int]] = []
        self.slots = slots
        self.channels = channels

    def append(self, code: int, klass: int) -> None:
        self.code.append(code)
        self.klass.append(klass)
        self.slot_layer.append([0] * self.slots)
        self.index.append([0] * 9)
        for i, channel in enumerate(self.channels):
            zeros = [0] * len(channel.rules)
            self.v[i].append([list(zeros) for _ in range(self.slots)] if channel.stream == OFFSETS else list(zeros))
            self.first[i].append(list(zeros))


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


def substreams(block: bytes) -> dict[int, bytes]:
    reader = Payload(block)
    records = [reader.fields("BII") for _ in range(reader.u8())]
    table = reader.at
    (crc,) = reader.fields("I")
    require(crc == zlib.crc32(block[:table]), "crc-mismatch")
    out = {}
    for kind, length, part_crc in records:
        out[kind] = reader.take(length)
        require(zlib.crc32(out[kind]) == part_crc, "crc-mismatch")
    return out


def table_contexts(tile: Tile, i: int, j: int, n: int, chosen: list[int]) -> list[int]:
    """first_contexts and trit_contexts of SPEC §8.4."""
    rule = tile.channels[i].rules[j]
    contexts = [16 * tile.klass[a] * rule.by_class for a in chosen]
    if n > 1:
        return [c + min(max(tile.v[i][a][j], -2), 2) + 2 for c, a in zip(contexts, chosen, strict=True)]
    if rule.source_channel == 255:
        return contexts
    source = [tile.first[rule.source_channel][a][rule.source_component] for a in chosen]
    return [c + min(max((s - rule.low) >> rule.shift, 0), 15) for c, s in zip(contexts, source, strict=True)]


def read_masks(rans: Rans, tile: Tile, k: int) -> None:
    on = [sum(layer > 0 for layer in slots) for slots in tile.slot_layer]
    for s in range(tile.slots):
        chosen = [a for a, slots in enumerate(tile.slot_layer) if slots[s] == 0]
        for a, bit in zip(chosen, rans.read_by_context(key(MASKS, 0, 0, 0), [on[a] for a in chosen]), strict=True):
            require(bit in (0, 1), "bad-mask")
            if bit:
                tile.slot_layer[a][s] = k
                on[a] += 1


def read_offsets(rans: Rans, tile: Tile, k: int, i: int) -> None:
    pairs = [(a, s) for a, slots in enumerate(tile.slot_layer) for s, layer in enumerate(slots) if layer == k]
    for j, rule in enumerate(tile.channels[i].rules):
        contexts = [16 * tile.klass[a] * rule.by_class for a, _ in pairs]
        for (a, s), value in zip(pairs, rans.read_by_context(key(OFFSETS, j, 1, 0), contexts), strict=True):
            tile.v[i][a][s][j] = value

"""Counts of the work of a decode that do not depend on the machine: bytes, symbols, multiply-adds, anchors.

A decode that is given :class:`Counters` adds to them; without any, nothing is counted. A tile has counters of its own,
added up in the order of the tiles, so that the result depends neither on threads nor on which array library computes.
"""

from __future__ import annotations

import collections
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol

from scarfmt.container.schema import Stream
from scarfmt.container.source import ByteSource


class Coding(StrEnum):
    """How a symbol is coded (SPEC §8)."""

    STATIC = "static"
    """With a table of the file, also one of a single symbol, which takes no bits."""
    UNIFORM = "uniform"
    MODELLED = "modelled"
    """With frequencies of its own, from the index network."""


class Part(StrEnum):
    """Models with weights, whose multiply-adds are counted."""

    PREDICTORS = "predictors"
    HASH_GRID = "hash_grid"
    """A feature takes as many as its cell has vertices."""
    INDEX_NETWORK = "index_network"
    INDEX_TABLES = "index_tables"
    """Products of the index network that are the same for all anchors: made once, whatever is decoded with them."""
    LATENT_DECODER = "latent_decoder"
    SCENE_NETWORKS = "scene_networks"
    """Networks of the anchor profile, evaluated when a model is baked."""


ALL, CODINGS = tuple(Stream), tuple(Coding)


class CountedReader(Protocol):
    """A reader of one sub-stream that counts the symbols it has read."""

    static: int
    uniform: int
    modelled: int


@dataclass
class Counters:
    """Totals of one decode, or of several added up.

    A multiply-add is counted for each weight that a row of inputs meets, in the sizes that the file gives its models:
    zeros that fill up a matrix, and sums laid side by side in one number, change no count.

    Attributes:
        bytes_read: bytes transferred from the source, read-ahead included.
        reads: transfers from the source.
        model_blocks, tile_blocks: blocks of which something was read.
        tiles: tiles decoded that have blocks.
        anchors: anchors decoded.
        visits: anchors known in a layer, over all layers decoded: how often one was looked at.
        symbols: symbols of tiles decoded, by sub-stream and coding.
        multiply_adds: by what multiplied.
    """

    bytes_read: int = 0
    reads: int = 0
    model_blocks: int = 0
    tile_blocks: int = 0
    tiles: int = 0
    anchors: int = 0
    visits: int = 0
    symbols: collections.Counter[tuple[Stream, Coding]] = field(default_factory=collections.Counter)
    multiply_adds: collections.Counter[Part] = field(default_factory=collections.Counter)

    def add(self, other: Counters) -> None:
        """Add the counts of `other` to these."""
        for name, value in vars(other).items():
            if isinstance(value, int):
                setattr(self, name, getattr(self, name) + value)
        self.symbols.update(other.symbols)
        self.multiply_adds.update(other.multiply_adds)

    def read(self, stream: Stream, reader: CountedReader) -> None:
        """Add the symbols that a reader of `stream` has read."""
        for coding, count in zip(CODINGS, (reader.static, reader.uniform, reader.modelled), strict=True):
            if count:
                self.symbols[stream, coding] += count

    def multiply(self, part: Part, rows: int, products: int) -> None:
        """Add `rows` evaluations of so many multiply-adds each."""
        if rows and products:
            self.multiply_adds[part] += rows * products

    def symbols_of(self, *, streams: Collection[Stream] = ALL, codings: Collection[Coding] = CODINGS) -> int:
        """Symbols of some sub-streams and codings, by default all."""
        return sum(n for (stream, coding), n in self.symbols.items() if stream in streams and coding in codings)

    def report(self) -> dict[str, Any]:
        """The counts as a JSON-able dictionary: totals, and what they are made of."""
        out = {name: value for name, value in vars(self).items() if isinstance(value, int)}
        out["blocks"] = self.model_blocks + self.tile_blocks
        out["symbols"] = self.symbols_of()
        by_stream = {stream.name.lower(): self.symbols_of(streams=(stream,)) for stream in Stream}
        by_coding = {coding.value: self.symbols_of(codings=(coding,)) for coding in Coding}
        by_part = {part.value: self.multiply_adds[part] for part in Part}
        return {
            **out,
            "symbols_by_stream": {name: count for name, count in by_stream.items() if count},
            "symbols_by_coding": by_coding,
            "multiply_adds": self.multiply_adds.total(),
            "multiply_adds_by_part": by_part,
        }


@contextmanager
def transfers(source: ByteSource, counters: Counters | None) -> Iterator[None]:
    """Add what is transferred from `source` meanwhile."""
    before = source.bytes_read, source.reads
    try:
        yield
    finally:
        if counters is not None:
            counters.bytes_read += source.bytes_read - before[0]
            counters.reads += source.reads - before[1]

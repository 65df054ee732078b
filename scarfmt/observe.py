"""Intermediate values of a decoder, for comparing it with another decoder.

A decode that is given an observer tells it; without one nothing is done. A layer of a tile has an observer of its
own, called by the one thread that decodes the tile.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

from scarfmt.arrays import F64, I64, Numbers
from scarfmt.container.schema import Stream
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.rans import make_uniform
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.entropy.symbol_tables import SymbolTable


class LayerObserver(Protocol):
    """Sees one layer of one tile. Arrays are only lent: one that is to be kept must be copied."""

    def frequencies(self, stream: Stream, stage: int, frequencies: Numbers) -> None:
        """A group of one or more symbols was coded with these, (n,) integers that sum to 2^24 (SPEC §8.1).

        Args:
            stage: of INDICES, from 1; 0 in other sub-streams.
            frequencies: where each symbol of the group has its own, those of the first.
        """

    def contexts(self, stream: Stream, component: int, step: int, contexts: I64) -> None:
        """The predictor of a step of a component gave these numbers to the anchors of a pass (SPEC §10.3)."""

    def embedding(self, h: Numbers) -> None:
        """(n, H) integers h of anchors whose indices are to be decoded, the next in coding order (SPEC §10.5)."""


Observe = Callable[[int, int], LayerObserver | None]
"""(tile, layer from 1) -> its observer, None for one not to be watched. Called by the thread that decodes the tile."""


class ObservedReader(SymbolReader):
    """A reader of one sub-stream that reports the tables it uses."""

    def __init__(
        self,
        data: bytes,
        tables: Mapping[TableKey, SymbolTable],
        stream: Stream,
        observer: LayerObserver,
    ) -> None:
        super().__init__(data, tables)
        self._stream = stream
        self._observer = observer

    def read(self, key: TableKey, count: int) -> I64:
        values = super().read(key, count)
        if count:
            stage = key.component if self._stream == Stream.INDICES else 0
            self._observer.frequencies(self._stream, stage, self._tables[key].table.frequencies)
        return values

    def read_uniform(self, size: int, count: int) -> I64:
        values = super().read_uniform(size, count)
        if count:
            self._observer.frequencies(self._stream, 0, make_uniform(size).frequencies)
        return values

    def read_rows(self, weights: F64, stage: int) -> I64:
        values = super().read_rows(weights, stage)
        if len(weights):
            self._observer.frequencies(self._stream, stage, weights[0] + 1)
        return values

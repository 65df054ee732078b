"""Intermediate values of a decode in its last layer: contexts, embeddings, frequencies, by tile (SPEC §10.3, §10.5).

The stages ``context`` and ``frequencies`` of conformance/PROTOCOL.md.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I64, Numbers
from scarfmt.container.schema import Stream

Arrays = dict[str, NDArray[Any]]


class LayerRecord:
    """An observer of one tile that keeps what the protocol asks for.

    Attributes:
        tables: by array name, frequencies (symbols) uint32 of the first symbol.
        parts: by array name, int32 rows pass by pass.
    """

    def __init__(self) -> None:
        self.tables: Arrays = {}
        self.parts: dict[str, list[NDArray[np.int32]]] = {}

    def frequencies(self, stream: Stream, stage: int, frequencies: Numbers) -> None:
        name = f"frequencies.{stream.name}" + (f".{stage}" if stage else "")
        if name not in self.tables:
            self.tables[name] = frequencies.astype("u4")

    def contexts(self, stream: Stream, component: int, step: int, contexts: I64) -> None:
        self._append(f"context.{stream.name}.{component}.{step}", contexts)

    def embedding(self, h: Numbers) -> None:
        self._append("embedding", h)

    def _append(self, name: str, rows: Numbers) -> None:
        # A copy, and of integers: what observers are shown is only lent.
        self.parts.setdefault(name, []).append(rows.astype("i4"))


class Records:
    """Observers of all tiles in one layer, each made by the thread that decodes its tile.

    Args:
        layer: from 1, the one to watch.
    """

    def __init__(self, layer: int) -> None:
        self._layer = layer
        self._tiles: dict[int, LayerRecord] = {}

    def observe(self, tile: int, layer: int) -> LayerRecord | None:
        """The observer of a tile, as the reader asks for it."""
        return self._tiles.setdefault(tile, LayerRecord()) if layer == self._layer else None

    def _in_order(self) -> list[LayerRecord]:
        return [record for _, record in sorted(self._tiles.items())]

    def contexts(self) -> Arrays:
        """Embeddings and predictor contexts, those that have a row; by tile, in coding order."""
        rows: dict[str, list[NDArray[np.int32]]] = {}
        for record in self._in_order():
            for name, parts in record.parts.items():
                rows.setdefault(name, []).extend(parts)
        joined = {name: np.concatenate(parts) for name, parts in rows.items()}
        return {name: array for name, array in joined.items() if len(array)}

    def frequencies(self) -> Arrays:
        """The frequencies of each sub-stream, or stage of INDICES, in the first tile that codes a symbol of it."""
        found: Arrays = {}
        for record in reversed(self._in_order()):
            found |= record.tables
        return found

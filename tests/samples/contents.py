"""The contents of tiles in a form that can be compared, for tests of files that are written, damaged or read."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scarfmt.blocks.metadata import read_metadata
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.container.schema import Stream
from scarfmt.container.source import BytesSource
from scarfmt.limits import DEFAULT_LIMITS, Limits

Contents = list[TileContent]

ATTRIBUTES = frozenset(Stream) - {Stream.MODELS, Stream.FRAMING, Stream.POSITIONS, Stream.CLASSES, Stream.MASKS}
"""Streams a caller may leave out."""


def arrays_of(tile: TileContent) -> list[NDArray[np.generic]]:
    """All arrays of a tile."""
    return [tile.codes, tile.classes, tile.indices, tile.slot_layers, *tile.values]


def read_everything(data: bytes, limits: Limits = DEFAULT_LIMITS) -> Contents:
    """All a reader can read of a file: metadata, models, tiles."""
    reader = SceneReader(BytesSource(data), limits=limits)
    read_metadata(reader.container)
    return [content for _, content in reader.tiles(reader.models())]

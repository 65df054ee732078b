"""Taking whole files apart and putting them together again, checksums right, for tests of damaged files."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from fuzz.testing.parts import resealed, resealed_tile
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.container.file import Block, Container, write_container
from scarfmt.container.schema import Stream
from scarfmt.container.source import BytesSource
from scarfmt.limits import DEFAULT_LIMITS, Limits
from scarfmt.tools.inspection import read_metadata

__all__ = [
    "ATTRIBUTES",
    "arrays_of",
    "blocks_of",
    "read_everything",
    "rebuilt",
    "resealed",
    "resealed_tile",
    "same_content",
    "without",
]

Contents = list[TileContent]


def same_content(a: TileContent, b: TileContent) -> bool:
    """Whether two tiles hold the same integers, in the same types."""
    return all(
        x.dtype == y.dtype and np.array_equal(x, y) for x, y in zip(arrays_of(a), arrays_of(b), strict=True)
    )


def arrays_of(tile: TileContent) -> list[NDArray[np.generic]]:
    """All arrays of a tile."""
    return [tile.codes, tile.classes, tile.indices, tile.slot_layers, *tile.values, *tile.first]


def read_everything(data: bytes, limits: Limits = DEFAULT_LIMITS) -> Contents:
    """All a reader can read of a file: metadata, models, tiles."""
    reader = SceneReader(BytesSource(data), limits=limits)
    read_metadata(reader.container)
    return [content for _, content in reader.tiles(reader.models())]


def blocks_of(data: bytes) -> list[Block]:
    """All blocks of a sound file; bytes of sub-streams are not kept apart."""
    container = Container.open(BytesSource(data))
    pairs = container.read_blocks(container.entries)
    return [Block(e.kind, e.layer, payload, e.tile, e.count, {}, e.flags) for e, payload in pairs]


def rebuilt(data: bytes, blocks: Iterable[Block]) -> bytes:
    """The file with other blocks, everything about them recomputed."""
    container = Container.open(BytesSource(data))
    counts = [(layer.anchor_count, layer.gaussian_count) for layer in container.header.layers]
    return write_container(container.header.fields, container.tiles, blocks, counts)


def without(data: bytes, unwanted: Callable[[Block], bool]) -> bytes:
    """The file without the blocks chosen."""
    return rebuilt(data, [block for block in blocks_of(data) if not unwanted(block)])


ATTRIBUTES = frozenset(Stream) - {Stream.MODELS, Stream.FRAMING, Stream.POSITIONS, Stream.CLASSES, Stream.MASKS}
"""Streams a caller may leave out."""

"""Decoding a file, or the parts of it that a request names, in memory or tile by tile.

Of the file only the bytes needed are read. The values are those that decoding the whole file gives.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Unpack

import numpy as np

from reference_decoder.backends import backend as engine_of
from reference_decoder.decoded import Decoded, joined, tile_part
from reference_decoder.dequantise import tile_boxes
from reference_decoder.request import DecodeRequest, RequestFields, requested
from scarfmt.coding.reader import ALL_STREAMS, SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.container.source import ByteSource, Origin, opened
from scarfmt.counters import Counters, transfers
from scarfmt.scene.streams import ATTRIBUTES


def decode(
    source: Origin,
    request: DecodeRequest | None = None,
    *,
    counters: Counters | None = None,
    **fields: Unpack[RequestFields],
) -> Decoded:
    """Decode a file, or what is asked of it, into memory.

    Args:
        source: a path, a URL, bytes, or an open :class:`ByteSource`, which stays open.
        request: what to decode; None for what `fields` say, and without them for everything.
        counters: what was read and computed is added to them; activating what is decoded is not part of it.
        fields: those of :class:`~reference_decoder.request.DecodeRequest`, in place of one.

    Raises:
        InvalidInput: ``input-layers``, ``input-tiles``, ``input-box``, ``input-attributes``, ``input-backend`` for
            a request that does not fit; ``input-source`` when the source cannot be opened.
        Malformed, Unsupported, LimitExceeded: the file is refused (SPEC §12).
        TypeError: `request` and `fields` were given, or a field that there is not.
    """
    wanted = requested(request, fields)
    with opened(source) as stream, transfers(stream, counters):
        decoding = _Decoding(stream, wanted, counters)
        return joined(decoding.parts(), decoding.empty, decoding.most_anchors)


def iter_tiles(
    source: Origin,
    request: DecodeRequest | None = None,
    *,
    counters: Counters | None = None,
    **fields: Unpack[RequestFields],
) -> Iterator[Decoded]:
    """Decode a tile at a time, so that memory does not grow with the scene. Arguments and errors of :func:`decode`.

    Together, in order, the parts are exactly what :func:`decode` gives. Tiles without anchors are left out. Bytes are
    counted when the last part was taken. Nothing is read or refused before the first part is asked for.
    """
    wanted = requested(request, fields)
    with opened(source) as stream, transfers(stream, counters):
        yield from _Decoding(stream, wanted, counters).parts()


class _Decoding:
    """A request checked against the file it is made of."""

    def __init__(self, source: ByteSource, request: DecodeRequest, counters: Counters | None) -> None:
        self.attributes = request.names()
        self.box = request.corners()
        self.reader = SceneReader(
            source,
            limits=request.limits,
            allow_truncated=request.allow_truncated,
            engine=engine_of(request.backend),
        )
        self.threads = request.threads
        self.counters = counters
        self.models = self.reader.models(request.layers, counters)
        self.tiles = self._chosen(request.tiles)

    def _chosen(self, tiles: Sequence[int] | None) -> list[int]:
        chosen = self.reader.check_tiles(tiles)
        if self.box is None:
            return chosen
        low, high = tile_boxes(self.reader.lattice, self.reader.container.tile_table)
        meets = np.asarray(((low <= self.box[1]) & (high >= self.box[0])).all(axis=1))
        return [tile for tile in chosen if meets[tile]]

    @property
    def streams(self) -> frozenset[Stream]:
        """Sub-streams to read."""
        if len(self.attributes) == len(ATTRIBUTES):
            return ALL_STREAMS
        # Latents are the sum of two streams; either alone means nothing.
        refined = {Stream.LATENT} if "latents" in self.attributes else set()
        return frozenset(ATTRIBUTES[name] for name in self.attributes) | refined

    @property
    def empty(self) -> Decoded:
        """No anchors, with arrays of the right shapes."""
        return self._part(-1, TileContent.empty(self.models.model))

    @property
    def most_anchors(self) -> int:
        """Anchors of the tiles asked for: as many as are decoded, unless a box leaves some out."""
        rows = self.reader.container.directory
        counted = (rows["kind"] == BlockKind.TILE) & (rows["layer"] <= len(self.models.model.layers))
        counts = np.zeros(self.reader.header.tile_count, np.int64)
        np.add.at(counts, rows["tile"][counted], rows["count"][counted])
        return int(counts[self.tiles].sum())

    def parts(self) -> Iterator[Decoded]:
        """What was asked for, a tile at a time; never an empty part."""
        found = self.reader.tiles(self.models, self.tiles, self.streams, self.threads, counters=self.counters)
        for tile, content in found:
            if not len(content):
                continue
            part = self._part(tile, content)
            if self.box is not None and part.positions is not None:
                inside = np.asarray(((part.positions >= self.box[0]) & (part.positions <= self.box[1])).all(axis=1))
                part = part if inside.all() else part.take(inside)
            if len(part):
                yield part

    def _part(self, tile: int, content: TileContent) -> Decoded:
        return tile_part(self.reader, self.models, tile, content, self.attributes, self.streams)

"""Decoding a file, or the parts of it that a request names, in memory or tile by tile.

Of the file only the bytes needed are read. The values are those that decoding the whole file gives.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import TypeVar, Unpack

import numpy as np

from reference_decoder import explicit
from reference_decoder.backends import backend as engine_of
from reference_decoder.decoded import Decoded, joined, tile_part
from reference_decoder.region import tiles_meeting
from reference_decoder.request import DecodeRequest, RequestFields, requested
from scarfmt.arrays import I64
from scarfmt.coding.reader import ALL_STREAMS, Act, SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.container.directory import tile_frame
from scarfmt.container.schema import Profile, Stream
from scarfmt.container.source import ByteSource, Origin, opened
from scarfmt.counters import Counters, transfers
from scarfmt.errors import LimitExceeded
from scarfmt.limits import Limits
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from scarfmt.scene.streams import ATTRIBUTES

T = TypeVar("T")


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
        LimitExceeded: ``limit-gathered`` where there are more anchors than :class:`~scarfmt.limits.Limits` allow to be
            held at once.
        Malformed, Unsupported, LimitExceeded: the file is refused (SPEC §12).
        TypeError: `request` and `fields` were given, or a field that there is not.
    """
    wanted = requested(request, fields)
    with opened(source) as stream, transfers(stream, counters):
        decoding = Decoding.of(stream, wanted, counters)
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
        yield from Decoding.of(stream, wanted, counters).parts()


def iter_made(
    source: Origin,
    request: DecodeRequest,
    make: Callable[[Decoded, Counters | None], T],
    counters: Counters | None = None,
) -> Iterator[T]:
    """The result of `make` for each part of :func:`iter_tiles` and the counters of its work, in the thread that decoded
    it.

    It never makes None.
    """
    with opened(source) as stream, transfers(stream, counters):
        yield from Decoding.of(stream, request, counters).made(make)


def decode_scene(
    source: Origin,
    request: DecodeRequest | None = None,
    *,
    counters: Counters | None = None,
    **fields: Unpack[RequestFields],
) -> GaussianScene | AnchorModel:
    """The scene of a file. It equals the `scene` of :func:`decode`, but the exact values are not kept.

    Half the memory and the time. Arguments and errors of :func:`decode`; all attributes are needed.

    Returns:
        Gaussians, or in the anchor profile a model that makes them for a camera.
    """
    wanted = requested(request, fields)
    with opened(source) as stream, transfers(stream, counters):
        decoding = Decoding.of(stream, wanted, counters)
        all_attributes = len(decoding.attributes) == len(ATTRIBUTES)
        if decoding.explicit and decoding.box is None and all_attributes and not _twice(decoding.tiles):
            return decoding.scene()
        return joined(decoding.parts(), decoding.empty, decoding.most_anchors).activated(counters=counters)


def reader_for(source: ByteSource, request: DecodeRequest) -> SceneReader:
    """A reader of a file, with the limits and the engine of a request.

    Raises:
        InvalidInput: ``input-backend``.
        Malformed, Unsupported, LimitExceeded: the front of the file is refused (SPEC §12).
    """
    engine = engine_of(request.backend)
    return SceneReader(source, limits=request.limits, allow_truncated=request.allow_truncated, engine=engine)


def check_gathered(anchors: int, slots: int, limits: Limits) -> None:
    """Check that so many anchors of so many slots may be held at once.

    Raises:
        LimitExceeded: ``limit-gathered``.
    """
    for number, most, what in (
        (anchors, limits.gathered, "anchors"),
        (anchors * slots, limits.gathered_slots, "Gaussian slots"),
    ):
        if number > most:
            message = f"{number} {what} at once, this reader's limit is {most}: decode a region, fewer layers, or "
            raise LimitExceeded("limit-gathered", f"{message}tile by tile (iter_tiles), or raise it")


def _twice(tiles: Sequence[int]) -> bool:
    """Whether a tile is asked for more than once."""
    return len(set(tiles)) < len(tiles)


class Decoding:
    """A request checked against the file it is made of.

    Args:
        reader: of the file, made for the request's limits and backend.
        request: what to decode.
        counters: what is computed is added to them.

    Raises:
        As :func:`decode`.
    """

    def __init__(self, reader: SceneReader, request: DecodeRequest, counters: Counters | None) -> None:
        self.attributes = request.names()
        self.box = request.corners()
        self.reader = reader
        self.threads = request.workers
        self.counters = counters
        self.limits = request.limits
        self.tiles = self._chosen(request.tiles)
        every = request.tiles is None and request.box is None
        self.models = self.reader.models(request.layers, counters, None if every else self.tiles)
        self.tiles = self._filled()

    @classmethod
    def of(cls, source: ByteSource, request: DecodeRequest, counters: Counters | None) -> Decoding:
        """A request made of the file that a source holds."""
        return cls(reader_for(source, request), request, counters)

    def _chosen(self, tiles: Sequence[int] | None) -> list[int]:
        chosen = self.reader.check_tiles(tiles)
        if self.box is None:
            return chosen
        meets = tiles_meeting(self.reader, self.box)
        return [tile for tile in chosen if meets[tile]]

    def _filled(self) -> list[int]:
        """The tiles asked for without those of which nothing is said, which would be empty parts."""
        tiles = np.array(self.tiles, np.int64)
        found: list[int] = tiles[self.reader.container.have_blocks(len(self.models.model.layers), tiles)].tolist()
        return found

    @property
    def explicit(self) -> bool:
        """Whether the file holds Gaussians themselves."""
        return self.reader.header.fields.profile == Profile.EXPLICIT

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
        return int(self._counts.sum())

    @cached_property
    def _counts(self) -> I64:
        """(n,) int64 anchors of each tile asked for after the last layer decoded.

        Raises:
            LimitExceeded: ``limit-gathered``: they are more than this reader holds at once.
        """
        layers = len(self.models.model.layers)
        counts: I64 = self.reader.container.tile_counts(layers, np.array(self.tiles, np.int64)).sum(axis=1)
        anchors, slots = int(counts.sum()), self.reader.header.fields.slots
        check_gathered(anchors, slots, self.limits)
        return counts

    def parts(self) -> Iterator[Decoded]:
        """The requested parts, one tile at a time; never an empty part."""
        for _, part in self.each(self._chosen_part):
            if len(part):
                yield part

    def each(self, act: Act[T], tiles: Sequence[int] | None = None) -> Iterator[tuple[int, T]]:
        """The result of `act` for each requested tile, or for `tiles`, on as many threads as were requested."""
        wanted = self.tiles if tiles is None else tiles
        return self.reader.each_tile(self.models, act, wanted, self.streams, self.threads, self.counters)

    def made(self, make: Callable[[Decoded, Counters | None], T], tiles: Sequence[int] | None = None) -> Iterator[T]:
        """The result of `make` for each part that is not empty, in the thread that decoded it.

        Args:
            make: makes anything but None.
            tiles: instead of those asked for.
        """

        def act(tile: int, content: TileContent, counters: Counters | None) -> T | None:
            part = self._chosen_part(tile, content, counters)
            return make(part, counters) if len(part) else None

        for _, found in self.each(act, tiles):
            if found is not None:
                yield found

    def _chosen_part(self, tile: int, content: TileContent, _counters: Counters | None) -> Decoded:
        part = self._part(tile, content)
        if self.box is None or part.positions is None:
            return part
        inside = np.asarray(((part.positions >= self.box[0]) & (part.positions <= self.box[1])).all(axis=1))
        return part if inside.all() else part.take(inside)

    def _part(self, tile: int, content: TileContent) -> Decoded:
        return tile_part(self.reader, self.models, tile, content, self.attributes, self.streams)

    def scene(self) -> GaussianScene:
        """The Gaussians of all anchors of the tiles asked for: each written once, where it stays."""
        counts = self._counts
        rows = {tile: slice(end - n, end) for tile, n, end in zip(self.tiles, counts, np.cumsum(counts), strict=True)}
        degree = self.reader.header.fields.sh_degree
        out = explicit.empty_scene(int(counts.sum()), degree)

        activation = self.reader.engine.activation(self.models)

        def put(tile: int, content: TileContent, counters: Counters | None) -> None:
            here = out.rows(rows[tile])
            if activation is None:
                made = self._part(tile, content).activated(counters=counters)
                assert isinstance(made, GaussianScene)
                here.assign(made)
            elif len(content):
                frame = tile_frame(self.reader.header.fields, self.reader.container.tile(tile))
                activation.put_tile(here, self.reader.lattice, frame, content)
                explicit.count_decoder(self.models, len(content), counters)

        deque(self.each(put), maxlen=0)
        return out

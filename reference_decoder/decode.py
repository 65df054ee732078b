"""Decoding a file, or the parts of it that a request names, in memory or tile by tile.

Of the file only the bytes needed are read. The values are those that decoding the whole file gives. The C library
decodes where there is one; what it refuses is read again by the definition in NumPy, which explains the refusal.
"""

from __future__ import annotations

import zlib
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from reference_decoder.decoded import Decoded, check_attributes, empty_anchors
from reference_decoder.region import tiles_meeting
from scarfmt.arrays import F64, I64
from scarfmt.coding.models import SceneModels
from scarfmt.coding.reader import ALL_STREAMS, SceneReader, TileBlocks
from scarfmt.coding.tile import find_needed
from scarfmt.container.schema import Profile, Stream
from scarfmt.container.source import ByteSource, Origin, use_source
from scarfmt.counters import Counters
from scarfmt.errors import InvalidInput, LimitExceeded
from scarfmt.limits import DEFAULT_LIMITS, FREE_WORK, Limits
from scarfmt.native.binding import library
from scarfmt.native.file import NativeFile, NativeTile
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import AnchorModel, GaussianScene, allocate_scene
from scarfmt.scene.streams import ATTRIBUTES
from scarfmt.threads import map_threads

Box = tuple[Sequence[float], Sequence[float]]
M = TypeVar("M", Decoded, GaussianScene)


@dataclass(frozen=True, kw_only=True)
class DecodeRequest:
    """The part of a file to decode, and how. The values are those of decoding the whole file.

    Attributes:
        layers: layers to decode, from the first; None for all that are there.
        tiles: tile indices, in the order wanted; None for all.
        box: lowest and highest world coordinates; anchors (not Gaussians) outside are left out, and tiles that
            cannot hold any inside are not read.
        attributes: one or more names of `scarfmt.scene.streams.ATTRIBUTES`; None for all. Classes and lattice positions
            are always read.
        limits: what to accept of the file (SPEC §13).
        threads: tiles decoded side by side, 1 or more; the result does not depend on it. None for
            :func:`scarfmt.threads.count_threads`.
        allow_truncated: use the whole layers of a file cut short instead of refusing it.
        native: whether the C library decodes where there is one; the result does not depend on it.
    """

    layers: int | None = None
    tiles: Sequence[int] | None = None
    box: Box | None = None
    attributes: Collection[str] | None = None
    limits: Limits = DEFAULT_LIMITS
    threads: int | None = None
    allow_truncated: bool = False
    native: bool = True

    def names(self) -> frozenset[str]:
        """The attributes to decode: a box needs positions, whatever else is asked for.

        Raises:
            InvalidInput: ``input-attributes`` for a name that no attribute has.
        """
        asked = ATTRIBUTES if self.attributes is None else self.attributes
        names = frozenset([asked] if isinstance(asked, str) else asked)
        if not names <= set(ATTRIBUTES):
            unknown = ", ".join(sorted(names - set(ATTRIBUTES)))
            raise InvalidInput("input-attributes", f"no attribute {unknown}; choose from {', '.join(ATTRIBUTES)}")
        return names if self.box is None else names | {"positions"}

    def corners(self) -> tuple[F64, F64] | None:
        """The (3,) float64 lowest and highest corner of the box, None without one.

        Raises:
            InvalidInput: ``input-box`` when these are not three coordinates each, the lowest first.
        """
        if self.box is None:
            return None
        try:
            box = np.array(self.box, np.float64)
        except ValueError:  # ragged
            box = np.zeros(0)
        if box.shape != (2, 3) or not bool((box[0] <= box[1]).all()):
            raise InvalidInput("input-box", "a box needs its 3 lowest and its 3 highest coordinates", field="box")
        return box[0], box[1]


def make_request(request: DecodeRequest | None, fields: dict[str, Any]) -> DecodeRequest:
    """The request of a call: one given whole, or the one its keywords describe.

    Raises:
        TypeError: both were given, or a keyword that is no field.
    """
    if request is None:
        return DecodeRequest(**fields)
    if fields:
        raise TypeError(f"give a DecodeRequest or its fields, not both: {', '.join(fields)}")
    return request


def decode(
    source: Origin, request: DecodeRequest | None = None, *, counters: Counters | None = None, **fields: Any
) -> Decoded:
    """Decode a file, or what is asked of it. Of a URL only the bytes needed are transferred.

    Args:
        source: a path, a URL, bytes, or an open :class:`ByteSource`, which stays open.
        request: what to decode; None for what `fields` say, and without them for everything.
        counters: what was read and decoded is added to them.
        fields: those of :class:`DecodeRequest`, in place of one.

    Returns:
        The exact values; `scene` makes of them a :class:`GaussianScene`, or an :class:`AnchorModel`.

    Raises:
        InvalidInput: ``input-layers``, ``input-tiles``, ``input-box``, ``input-attributes`` for a request that does not
            fit; ``input-source`` when the source cannot be opened.
        LimitExceeded: ``limit-gathered`` where there are more anchors than :class:`~scarfmt.limits.Limits` allow to be
            held at once.
        Malformed, Unsupported, LimitExceeded: the file is refused (SPEC §12).
        TypeError: `request` and `fields` were given, or a field that there is not.
    """
    with use_source(source) as stream:
        decoding = Decoding(stream, make_request(request, fields), counters)
        return decoding.whole(decoding.anchors)


def iter_tiles(
    source: Origin, request: DecodeRequest | None = None, *, counters: Counters | None = None, **fields: Any
) -> Iterator[Decoded]:
    """Decode a tile at a time, so that memory does not grow with the scene. Arguments and errors of :func:`decode`.

    Together, in order, the parts are exactly what :func:`decode` gives. Tiles without anchors are left out. Bytes are
    counted when the last part was taken. Nothing is read or refused before the first part is asked for.
    """
    with use_source(source) as stream:
        decoding = Decoding(stream, make_request(request, fields), counters)
        yield from decoding.parts(decoding.anchors)


def decode_scene(
    source: Origin, request: DecodeRequest | None = None, *, counters: Counters | None = None, **fields: Any
) -> GaussianScene | AnchorModel:
    """The `scene` of :func:`decode`, within the tolerances of SPEC §9.5, in half the memory and time.

    Arguments and errors are those of :func:`decode`; all attributes are needed.

    Returns:
        Gaussians, or in the anchor profile a model that makes them for a camera.
    """
    with use_source(source) as stream:
        decoding = Decoding(stream, make_request(request, fields), counters)
        if decoding.reader.header.fields.profile == Profile.EXPLICIT:
            return decoding.whole(decoding.gaussians)
        return decoding.whole(decoding.anchors).activate()


class Decoding:
    """A request checked against the file it is made of. :meth:`whole` or :meth:`parts` answers it, once.

    Attributes:
        reader: of the file.
        tiles: those asked for of which the file says anything.
        counts: (n,) int64 anchors of each of them after the last layer decoded, without regard to a box.

    Args:
        counters: what is read and decoded is added to them.

    Raises:
        As :func:`decode`.
    """

    def __init__(self, source: ByteSource, request: DecodeRequest, counters: Counters | None) -> None:
        self._read_before = source.bytes_read, source.reads
        self.attributes, self.box = request.names(), request.corners()
        self.request = request
        self.counters = Counters() if counters is None else counters
        self.reader = SceneReader(source, limits=request.limits, allow_truncated=request.allow_truncated)
        self.layers = self.reader.layer_number(request.layers)
        self._chosen = choose_tiles(self.reader, request)
        everything = request.tiles is None and request.box is None
        self.reader.container.load(self.layers, None if everything else self._chosen.tolist())
        self._payloads = self.reader.model_payloads(self.layers)
        self.counters.model_blocks += len(self._payloads)
        self._native = self._open() if request.native else None
        if self._native is None:
            _ = self.models
        # Tiles of which nothing is said would be empty parts.
        filled = self._chosen[self.reader.container.have_blocks(self.layers, self._chosen)]
        self.tiles: list[int] = filled.tolist()
        self.counts: I64 = self.reader.container.tile_counts(self.layers, filled).sum(axis=1)

    @cached_property
    def models(self) -> SceneModels:
        """The models as they are defined: what explains a refusal, and what is in them.

        Raises:
            Malformed, LimitExceeded: they are refused, or the work that the file declares.
        """
        return self.reader.models_of(self.layers, self._payloads, self._chosen.tolist())

    def _open(self) -> NativeFile | None:
        """The file in the C library; None where there is no library, or where it refuses a model."""
        native, header, limits = library(), self.reader.header, self.request.limits
        if native is None:
            return None
        blocks = {(entry.layer, entry.kind): payload for entry, payload in self._payloads.items()}
        found = NativeFile(native, header.fields, header.file_length, self.layers, blocks)
        if found.refusal is not None:
            return None
        work = found.work(*self.reader.extent(self.layers, self._chosen))
        most = FREE_WORK + limits.work_per_byte * header.file_length
        # The library knows the usual limit of numbers alone, and leaves the work of networks to the definition.
        if not 0 <= work <= most or limits.numbers_per_byte < DEFAULT_LIMITS.numbers_per_byte:
            _ = self.models
        return found

    @cached_property
    def streams(self) -> frozenset[Stream]:
        """Sub-streams to read."""
        if len(self.attributes) == len(ATTRIBUTES):
            return ALL_STREAMS
        # Latents are the sum of two streams; either alone means nothing.
        refined = {Stream.LATENT} if "latents" in self.attributes else set()
        return frozenset(ATTRIBUTES[name] for name in self.attributes) | refined

    @cached_property
    def _needed(self) -> frozenset[Stream]:
        """Sub-streams that are read to decode those asked for."""
        if self.streams == ALL_STREAMS:
            return self.streams
        neural = self.models.neural(indices=Stream.INDICES in self.streams)[-1]
        return self.streams | find_needed(self.models.model, self.streams, neural)

    def anchors(self, count: int) -> Decoded:
        """Room for the values of anchors."""
        if self._native is not None:
            channels, stages = self._native.channels, self._native.stages
        else:
            model = self.models.model
            channels, stages = [(channel.stream, channel.components) for channel in model.channels], model.max_stages
        fields, attributes = self.reader.header.fields, self.attributes
        return empty_anchors(
            fields, self.layers, lambda: self.models, channels, stages, count, attributes, self.streams
        )

    def gaussians(self, count: int) -> GaussianScene:
        """Room for Gaussians of the explicit profile.

        Raises:
            InvalidInput: ``input-attributes``: some are left out.
        """
        check_attributes(self.attributes, ATTRIBUTES)
        fields = self.reader.header.fields
        return allocate_scene(count, fields.sh_degree, Description.of_header(fields))

    def whole(self, room: Callable[[int], M]) -> M:
        """All that was asked for, each number written once, where it stays.

        Args:
            room: :meth:`anchors` or :meth:`gaussians`.

        Raises:
            LimitExceeded: ``limit-gathered``: it is more than this reader holds at once.
        """
        counts = self.counts
        check_gathered(int(counts.sum()), self.reader.header.fields.slots, self.request.limits)
        out, ends = room(int(counts.sum())), np.cumsum(counts).tolist()
        parts = (out.rows(slice(end - count, end)) for end, count in zip(ends, counts.tolist(), strict=True))
        deque(self._fill(parts), maxlen=0)
        return out if self.box is None else crop(out, self.box)

    def parts(self, room: Callable[[int], M]) -> Iterator[M]:
        """What was asked for, one tile at a time; never an empty part. The argument of :meth:`whole`."""
        found = self._fill(map(room, self.counts.tolist()))
        return filter(len, found if self.box is None else (crop(made, self.box) for made in found))

    def _fill(self, rooms: Iterable[M]) -> Iterator[M]:
        """The rooms of the tiles, in order, filled in on as many threads as were requested."""
        tiles = zip(self.tiles, self.reader.supply(self.layers, self.tiles, self.streams), rooms, strict=True)
        try:
            for blocks, made in map_threads(self._fill_one, tiles, self.request.threads):
                entries = [entry for entry, _ in blocks if entry is not None]
                self.counters.tile_blocks += len(entries)
                self.counters.tiles += 1
                self.counters.anchors += sum(entry.count for entry in entries)
                yield made
        finally:
            source = self.reader.container.source
            self.counters.bytes_read += source.bytes_read - self._read_before[0]
            self.counters.reads += source.reads - self._read_before[1]

    def _fill_one(self, given: tuple[int, TileBlocks, M]) -> tuple[TileBlocks, M]:
        tile, blocks, out = given
        found = None if self._native is None else self._native_tile(self._native, tile, blocks)
        if found is not None and isinstance(out, GaussianScene):
            found.put(out)
        elif found is not None:
            out.put_native(tile, found)
        else:
            made = self.anchors(len(out)) if isinstance(out, GaussianScene) else out
            content = self.reader.tile(self.models, tile, blocks, self.streams)
            made.put_content(self.reader, self.models.model, tile, content)
            if isinstance(out, GaussianScene):
                scene = made.activate()
                assert isinstance(scene, GaussianScene)
                out.assign(scene)
        return blocks, out

    def _native_tile(self, native: NativeFile, tile: int, blocks: TileBlocks) -> NativeTile | None:
        """A tile read in C; None if it has a fault."""
        given = []
        for entry, payload in blocks:
            if entry is not None and payload is None:
                payload = self.reader.read_parts(entry, self._needed, self.models.model)
            elif entry is not None and payload is not None and zlib.crc32(payload) != entry.crc32:
                return None
            given.append((entry.count if entry else 0, payload))
        return native.tile(self.reader.container.tile(tile), given, self._needed)


def choose_tiles(reader: SceneReader, request: DecodeRequest) -> I64:
    """The tiles of a request, in its order: those named, or all, that may have something in its box.

    Raises:
        InvalidInput: ``input-tiles``, ``input-box``.
    """
    tiles, box = np.array(reader.check_tiles(request.tiles), np.int64), request.corners()
    return tiles if box is None else tiles[tiles_meeting(reader, box)[tiles]]


def crop(made: M, box: tuple[F64, F64]) -> M:
    """What of it lies in a box."""
    at = made.positions
    assert at is not None  # a box needs them
    return made.take(np.asarray(((at >= box[0]) & (at <= box[1])).all(axis=1)))


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


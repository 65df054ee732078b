"""Decoding a file: everything, or only some layers, tiles, attributes or a box, in memory or tile by tile.

Order of anchors is normative: by tile, then layer of first appearance, then Morton code (SPEC §6.3). Whatever is
asked for, the values are those that decoding the whole file gives.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reference_decoder import explicit
from reference_decoder.anchors import decoded_model
from reference_decoder.backends import operations
from reference_decoder.dequantise import channel_values, latents, offset_values, positions, tile_boxes
from scarfmt.codecs.channels import cell_widths
from scarfmt.coding.counters import Counters, transfers
from scarfmt.coding.reader import ALL_STREAMS, SceneModels, SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.container.header import HeaderFields
from scarfmt.container.schema import BlockKind, Profile, Stream
from scarfmt.container.source import ByteSource, open_source
from scarfmt.errors import InvalidInput
from scarfmt.limits import DEFAULT_LIMITS, Limits
from scarfmt.scene.gaussians import F32, F64, AnchorModel, GaussianScene

Origin = str | os.PathLike[str] | bytes | bytearray | memoryview | ByteSource
Box = tuple[Sequence[float], Sequence[float]]
I16 = NDArray[np.int16]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
U8 = NDArray[np.uint8]

ATTRIBUTES = {
    "positions": Stream.POSITION_RESIDUAL,
    "scales": Stream.SCALE,
    "rotations": Stream.ROTATION,
    "opacity": Stream.OPACITY,
    "colour": Stream.COLOUR,
    "latents": Stream.INDICES,
    "offsets": Stream.OFFSETS,
}
"""Names of what can be asked for on its own, and the sub-stream each needs; latents need LATENT too."""


@dataclass(frozen=True)
class Decoded:
    """N decoded anchors; all arrays are exact, equal in every conforming decoder.

    Attributes:
        fields: header fields of the file.
        models: codebooks, networks and layer table up to the layer decoded.
        attributes: names decoded, see `ATTRIBUTES`.
        tiles: (N,) int32 index of each anchor's tile.
        classes: (N,) uint8 class of each anchor.
        positions: (N, 3) float64 world units; None unless decoded.
        values: channels decoded, (N, components) float32 (offsets: (N, K, 3)), in coded units (SPEC §9.2).
        indices: (N, M) int16 codeword numbers; None unless decoded.
        slots: (N, K) bool Gaussian slots that are on; K = 0 in the explicit profile.
    """

    fields: HeaderFields
    models: SceneModels
    attributes: frozenset[str]
    tiles: I32
    classes: U8
    positions: F64 | None
    values: dict[Stream, F32]
    indices: I16 | None
    slots: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.tiles)

    @property
    def layers(self) -> int:
        """Layers decoded."""
        return len(self.models.model.layers)

    @property
    def stages(self) -> I64:
        """(N,) int64 RVQ stages received."""
        return self.models.model.stages(self.layers, self.classes.astype(np.int64))

    @property
    def latents(self) -> F32:
        """(N, d) float32 exact latents; d = 0 while no layer needs the latent decoder.

        Raises:
            InvalidInput: ``input-attributes`` when they were not decoded.
        """
        indices = self._decoded("latents", self.indices)
        dimension = self.models.decoder.inputs if self.models.decoder else 0
        refinements = self.values.get(Stream.LATENT) if dimension else None
        return latents(self.models.codebooks, indices, self.stages, refinements, dimension)

    @cached_property
    def scene(self) -> GaussianScene | AnchorModel:
        """What there is to draw: Gaussians, or in the anchor profile a model that makes them for a camera.

        Raises:
            InvalidInput: ``input-attributes`` when not all attributes were decoded.
        """
        return self.activated()

    def activated(self, dtype: type = np.float32, counters: Counters | None = None) -> GaussianScene | AnchorModel:
        """As `scene`, computed in `dtype`: float64 is the reference of the tolerances (SPEC §9.5).

        Args:
            dtype: of the result.
            counters: the latent decoder's multiply-adds are added to them.
        """
        missing = [name for name in ATTRIBUTES if name not in self.attributes]
        if missing:
            message = f"a scene needs all attributes, {', '.join(missing)} were left out"
            raise InvalidInput("input-attributes", message, field="attributes")
        at, indices = self._decoded("positions", self.positions), self._decoded("latents", self.indices)
        if self.fields.profile == Profile.ANCHOR:
            return decoded_model(at, self.values, self.models, self.slots, indices, self.stages, dtype, counters)
        degree = self.fields.sh_degree
        return explicit.gaussians(at, self.values, self.models, degree, indices, self.stages, dtype, counters)

    def _decoded(self, name: str, values: NDArray[Any] | None) -> NDArray[Any]:
        if values is None:
            raise InvalidInput("input-attributes", f"{name} were left out of this decode", field="attributes")
        return values

    def take(self, index: NDArray[np.generic]) -> Decoded:
        """The anchors at `index` (integer or boolean, as numpy indexing), in that order."""
        return self._mapped(lambda array: array[index])

    def resized(self, count: int) -> Decoded:
        """The first `count` anchors in arrays of their own; what is not there yet is undefined."""

        def resize(array: NDArray[Any]) -> NDArray[Any]:
            out = np.empty((count, *array.shape[1:]), array.dtype)
            out[: len(array)] = array[:count]
            return out

        return self._mapped(resize)

    def arrays(self) -> list[NDArray[Any]]:
        """All arrays that were decoded, always in the same order."""
        optional = [array for array in (self.positions, self.indices) if array is not None]
        return [self.tiles, self.classes, *optional, *self.values.values(), self.slots]

    def _mapped(self, act: Callable[[NDArray[Any]], NDArray[Any]]) -> Decoded:
        return Decoded(
            self.fields,
            self.models,
            self.attributes,
            act(self.tiles),
            act(self.classes),
            None if self.positions is None else act(self.positions),
            {stream: act(values) for stream, values in self.values.items()},
            None if self.indices is None else act(self.indices),
            act(self.slots),
        )


def decode(
    source: Origin,
    *,
    layers: int | None = None,
    tiles: Sequence[int] | None = None,
    box: Box | None = None,
    attributes: Collection[str] | None = None,
    limits: Limits = DEFAULT_LIMITS,
    threads: int = 1,
    allow_truncated: bool = False,
    backend: str = "numpy",
    counters: Counters | None = None,
) -> Decoded:
    """Decode a file, or what is asked of it, into memory. Only the bytes needed are read.

    Args:
        source: a path, a URL, bytes, or an open :class:`ByteSource`, which stays open.
        layers: layers to decode, from the first; None for all that are there.
        tiles: tile indices, in the order wanted; None for all.
        box: lowest and highest world coordinates; anchors (not Gaussians) outside are left out, and tiles
            that cannot hold any inside are not read.
        attributes: names of `ATTRIBUTES`; None for all. Classes and lattice positions are always read.
        limits: what to accept of the file.
        threads: tiles decoded side by side; the result does not depend on it.
        allow_truncated: use the whole layers of a file cut short instead of refusing it.
        backend: what computes the index network: one of `backends.BACKENDS`; the result does not depend on it.
        counters: what was read and computed is added to them; activating what is decoded is not part of it.

    Raises:
        InvalidInput: ``input-layers``, ``input-tiles``, ``input-box``, ``input-attributes``, ``input-backend`` for
            arguments that do not fit; ``input-source`` when the source cannot be opened.
        Malformed, Unsupported, LimitExceeded: the file is refused (SPEC §12).
    """
    with opened(source) as stream, transfers(stream, counters):
        request = _Request(stream, layers, tiles, box, attributes, limits, threads, allow_truncated, backend, counters)
        return joined(request.parts(), request.empty, request.most_anchors)


def iter_tiles(
    source: Origin,
    *,
    layers: int | None = None,
    tiles: Sequence[int] | None = None,
    box: Box | None = None,
    attributes: Collection[str] | None = None,
    limits: Limits = DEFAULT_LIMITS,
    threads: int = 1,
    allow_truncated: bool = False,
    backend: str = "numpy",
    counters: Counters | None = None,
) -> Iterator[Decoded]:
    """The same as :func:`decode`, a tile at a time: memory does not grow with the scene.

    Together, in order, the parts are exactly what :func:`decode` gives. Tiles without anchors are left out. Bytes are
    counted when the last part was taken.
    """
    with opened(source) as stream, transfers(stream, counters):
        request = _Request(stream, layers, tiles, box, attributes, limits, threads, allow_truncated, backend, counters)
        yield from request.parts()


@contextmanager
def opened(source: Origin) -> Iterator[ByteSource]:
    """The byte source of a path, URL or bytes, closed afterwards; a ByteSource is passed through and stays open."""
    if isinstance(source, str | os.PathLike | bytes | bytearray | memoryview):
        with open_source(source) as stream:
            yield stream
    else:
        yield source


class _Request:
    """The arguments of a decode, checked against the file."""

    def __init__(
        self,
        source: ByteSource,
        layers: int | None,
        tiles: Sequence[int] | None,
        box: Box | None,
        attributes: Collection[str] | None,
        limits: Limits,
        threads: int,
        allow_truncated: bool,
        backend: str,
        counters: Counters | None,
    ) -> None:
        self.attributes = _names(attributes, box is not None)
        self.box = None if box is None else _corners(box)
        self.reader = SceneReader(
            source, limits=limits, allow_truncated=allow_truncated, operations=operations(backend)
        )
        self.threads = threads
        self.counters = counters
        self.models = self.reader.models(layers, counters)
        self.tiles = self._chosen(tiles)

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


def tile_part(
    reader: SceneReader,
    models: SceneModels,
    tile: int,
    content: TileContent,
    attributes: frozenset[str] = frozenset(ATTRIBUTES),
    streams: frozenset[Stream] = ALL_STREAMS,
) -> Decoded:
    """The values of one tile, from its integers.

    Args:
        reader: of the file.
        models: those it was read with.
        tile: its number; any where it holds no anchors.
        content: as the reader gives it.
        attributes: names to give values of.
        streams: the sub-streams that were read for them.
    """
    model = models.model
    values: dict[Stream, F32] = {}
    residuals: F64 | None = None
    for index, channel in enumerate(model.channels):
        if channel.stream not in streams:
            continue
        steps = model.steps(len(model.layers), index, content.classes)
        if channel.stream == Stream.OFFSETS:
            values[channel.stream] = offset_values(content.values[index], channel.first_width)
        elif channel.stream == Stream.POSITION_RESIDUAL:
            residuals = content.values[index] * cell_widths(channel.first_width, steps)
        else:
            values[channel.stream] = channel_values(content.values[index], channel.first_width, steps)
    return Decoded(
        reader.header.fields,
        models,
        attributes,
        np.full(len(content), tile, np.int32),
        content.classes.astype(np.uint8),
        _positions(reader, tile, content, residuals) if "positions" in attributes else None,
        values,
        content.indices if "latents" in attributes else None,
        content.slot_layers > 0,
    )


def _positions(reader: SceneReader, tile: int, content: TileContent, residuals: F64 | None) -> F64:
    if not len(content):
        return np.zeros((0, 3))
    return positions(reader.lattice, reader.container.tiles[tile], content.codes, residuals)


def _names(attributes: Collection[str] | None, with_positions: bool) -> frozenset[str]:
    names = frozenset(ATTRIBUTES if attributes is None else attributes)
    if not names <= set(ATTRIBUTES):
        unknown = ", ".join(sorted(names - set(ATTRIBUTES)))
        raise InvalidInput("input-attributes", f"no attribute {unknown}; choose from {', '.join(ATTRIBUTES)}")
    return names | {"positions"} if with_positions else names


def _corners(box: Box) -> tuple[F64, F64]:
    low, high = (np.asarray(corner, np.float64) for corner in box)
    if low.shape != (3,) or high.shape != (3,) or not bool((low <= high).all()):
        raise InvalidInput("input-box", "a box is its 3 lowest and its 3 highest coordinates", field="box")
    return low, high


def joined(parts: Iterator[Decoded], empty: Decoded, count: int) -> Decoded:
    """All parts as one, in order.

    Args:
        parts: made while they are joined, so that no two copies of a scene are in memory.
        empty: no anchors, with the right types.
        count: most anchors the parts can have.
    """
    whole = empty.resized(count)
    filled = 0
    for part in parts:
        rows = slice(filled, filled + len(part))
        for target, source in zip(whole.arrays(), part.arrays(), strict=True):
            target[rows] = source
        filled += len(part)
    return whole if filled == count else whole.resized(filled)

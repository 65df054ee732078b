"""The result of a decode: exact values of anchors, and a scene made of them (SPEC §9).

The order of anchors is normative: by tile, then layer of first appearance, then Morton code (SPEC §6.3).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reference_decoder import explicit
from reference_decoder.anchors import decoded_model
from reference_decoder.dequantise import latents, offset_values, positions
from scarfmt.arrays import F32, F64, I16, I32, I64, U8
from scarfmt.codecs.channels import cell_widths
from scarfmt.coding.engine import NUMPY_ENGINE, Engine
from scarfmt.coding.models import SceneModels
from scarfmt.coding.reader import ALL_STREAMS, SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.container.directory import tile_frame
from scarfmt.container.header import HeaderFields
from scarfmt.container.schema import Profile, Stream
from scarfmt.counters import Counters
from scarfmt.errors import InvalidInput
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from scarfmt.scene.model import Channel
from scarfmt.scene.streams import ATTRIBUTES


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
        engine: what activates them.
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
    engine: Engine = NUMPY_ENGINE

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
        """The scene to draw: Gaussians, or in the anchor profile a model that makes them for a camera.

        Raises:
            InvalidInput: ``input-attributes`` when not all attributes were decoded.
        """
        return self.activated()

    def activated(self, dtype: type = np.float32, counters: Counters | None = None) -> GaussianScene | AnchorModel:
        """The `scene` computed in `dtype`. In float64 it is the reference of the tolerances (SPEC §9.5).

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
        activation = self.engine.activation(self.models) if dtype is np.float32 else None
        return explicit.gaussians(
            at, self.values, self.models, degree, indices, self.stages, dtype, counters, activation
        )

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
            self.engine,
        )


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
    residuals: Residuals | None = None
    for index, channel in enumerate(model.channels):
        if channel.stream not in streams:
            continue
        steps = model.steps(len(model.layers), index, content.classes)
        if channel.per_slot:
            values[channel.stream] = offset_values(content.values[index], channel.first_width)
        elif channel.stream == Stream.POSITION_RESIDUAL:
            residuals = channel, content.values[index], steps
        else:
            values[channel.stream] = reader.engine.channel_values(content.values[index], channel.first_width, steps)
    return Decoded(
        reader.header.fields,
        models,
        attributes,
        np.full(len(content), tile, np.int32),
        content.classes.astype(np.uint8),
        _positions(reader, tile, content, residuals) if "positions" in attributes else None,
        values,
        content.indices.copy() if "latents" in attributes else None,
        content.slot_layers > 0,
        reader.engine,
    )


Residuals = tuple[Channel, I32, I64]
"""The channel of position residuals, (n, 3) int32 values, and the (n,) steps they are at."""


def _positions(reader: SceneReader, tile: int, content: TileContent, residuals: Residuals | None) -> F64:
    if not len(content):
        return np.zeros((0, 3))
    place = reader.container.tile(tile)
    frame = tile_frame(reader.header.fields, place)
    found = reader.engine.world_positions(reader.lattice, frame, content.codes, residuals)
    if found is not None:
        return found
    apart = None
    if residuals is not None:
        channel, values, steps = residuals
        apart = values * cell_widths(channel.first_width, steps)
    return positions(reader.lattice, place, content.codes, apart)


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

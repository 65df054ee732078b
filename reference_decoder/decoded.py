"""The result of a decode: exact values of anchors, and a scene made of them (SPEC §9).

The order of anchors is normative: by tile, then layer of first appearance, then Morton code (SPEC §6.3).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reference_decoder import reconstruct
from scarfmt.arrays import F32, F64, I16, I32, I64, U8
from scarfmt.coding.models import SceneModels
from scarfmt.coding.reader import ALL_STREAMS, SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.container.header import HeaderFields
from scarfmt.container.schema import Profile, Stream
from scarfmt.errors import InvalidInput, plural
from scarfmt.native.file import NativeTile, What
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from scarfmt.scene.model import SceneModel
from scarfmt.scene.streams import ATTRIBUTES


@dataclass(frozen=True)
class Decoded:
    """N decoded anchors; all arrays are exact, equal in every conforming decoder.

    Attributes:
        fields: header fields of the file.
        layers: layers decoded.
        load_models: gives `models`.
        attributes: names decoded, see `ATTRIBUTES`.
        tiles: (N,) int32 index of each anchor's tile.
        classes: (N,) uint8 class of each anchor.
        positions: (N, 3) float64 world units; None unless decoded.
        values: channels decoded, (N, components) float32 (offsets: (N, K, 3)), in coded units (SPEC §9.2).
        indices: (N, M) int16 codeword numbers; None unless decoded.
        slots: (N, K) bool Gaussian slots that are on; K = 0 in the explicit profile.
    """

    fields: HeaderFields
    layers: int
    load_models: Callable[[], SceneModels]
    attributes: frozenset[str]
    tiles: I32
    classes: U8
    positions: F64 | None
    values: dict[Stream, F32]
    indices: I16 | None
    slots: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.tiles)

    def __repr__(self) -> str:
        return f"<Decoded: {plural(len(self), 'anchor')} of {plural(self.layers, 'layer')}>"

    @property
    def models(self) -> SceneModels:
        """Codebooks, networks and layer table up to the layer decoded."""
        return self.load_models()

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
        books, indices, stages = self._codewords()
        dimension = self.models.decoder.inputs if self.models.decoder else 0
        refinements = self.values.get(Stream.LATENT) if dimension else None
        return reconstruct.latents(books, indices, stages, refinements, dimension)

    @cached_property
    def scene(self) -> GaussianScene | AnchorModel:
        """The scene to draw: Gaussians, or in the anchor profile a model that makes them for a camera.

        Raises:
            InvalidInput: ``input-attributes`` when not all attributes were decoded.
        """
        return self.activate()

    def activate(self, dtype: type = np.float32) -> GaussianScene | AnchorModel:
        """The `scene` computed in `dtype`. In float64 it is the reference of the tolerances (SPEC §9.5)."""
        check_attributes(self.attributes, ATTRIBUTES)
        assert self.positions is not None
        models, codewords = self.models, self._codewords()
        if self.fields.profile == Profile.ANCHOR:
            assert models.decoder is not None  # layer 1 of the anchor profile has one (SPEC §6.5)
            networks = models.decoder, models.scene_mlps
            return reconstruct.anchor_model(self.positions, self.values, self.slots, *networks, codewords, dtype)
        degree, decoder = self.fields.sh_degree, models.decoder
        described = Description.of_header(self.fields)
        return reconstruct.explicit_scene(self.positions, self.values, degree, decoder, codewords, described, dtype)

    def _codewords(self) -> reconstruct.Codewords:
        check_attributes(self.attributes, ["latents"])
        assert self.indices is not None
        return self.models.codebooks, self.indices, self.stages

    def take(self, index: NDArray[np.generic] | slice) -> Decoded:
        """The anchors at `index` (as numpy indexing), in that order; of a slice, views of them."""

        def choose(value: Any) -> Any:
            if isinstance(value, dict):
                return {stream: values[index] for stream, values in value.items()}
            return value[index] if isinstance(value, np.ndarray) else value

        return Decoded(*(choose(getattr(self, field.name)) for field in fields(self)))

    rows = take

    def arrays(self) -> list[NDArray[Any]]:
        """All arrays that were decoded, always in the same order."""
        optional = [array for array in (self.positions, self.indices) if array is not None]
        return [self.tiles, self.classes, *optional, *self.values.values(), self.slots]

    def put_content(self, reader: SceneReader, model: SceneModel, tile: int, content: TileContent) -> None:
        """Fill in a tile, from its integers as the reader gives them; sub-streams that were not read count as 0."""
        self.tiles[:], self.classes[:], self.slots[:] = tile, content.classes, content.slot_layers > 0
        values = reconstruct.channel_arrays(model, content)
        for stream, array in self.values.items():
            array[:] = values[stream]
        if self.positions is not None and len(content):
            apart = reconstruct.residuals(model, content)
            self.positions[:] = reconstruct.positions(reader.lattice, reader.container.tile(tile), content.codes, apart)
        if self.indices is not None:
            self.indices[:] = content.indices

    def put_native(self, tile: int, found: NativeTile) -> None:
        """Fill in a tile that the C library has read; the same as :meth:`put_content`."""
        self.tiles[:] = tile
        found.put_numbers(What.CLASSES, np.uint8, self.classes)
        found.put_numbers(What.SLOTS, np.uint8, self.slots)
        for index, (stream, _) in enumerate(found.file.channels):
            if stream in self.values:
                found.put_numbers(What.VALUES, np.float32, self.values[stream], index)
        if self.positions is not None:
            found.put_numbers(What.POSITIONS, np.float64, self.positions)
        if self.indices is not None:
            found.put_numbers(What.INDICES, np.int16, self.indices)


def check_attributes(decoded: frozenset[str], needed: Iterable[str]) -> None:
    """Check that what is needed was decoded.

    Raises:
        InvalidInput: ``input-attributes``.
    """
    missing = [name for name in needed if name not in decoded]
    if missing:
        message = f"a scene needs all attributes, {', '.join(missing)} were left out"
        raise InvalidInput("input-attributes", message, field="attributes")


def empty_anchors(
    header: HeaderFields,
    layers: int,
    load_models: Callable[[], SceneModels],
    channels: Sequence[tuple[Stream, int]],
    stages: int,
    count: int,
    attributes: frozenset[str] = frozenset(ATTRIBUTES),
    streams: frozenset[Stream] = ALL_STREAMS,
) -> Decoded:
    """Room for `count` anchors, to be filled in.

    Args:
        header, layers, load_models, attributes: as of :class:`Decoded`.
        channels: stream and components of each.
        stages: columns of indices.
        count: N.
        streams: the sub-streams that are read for the attributes.
    """
    values: dict[Stream, F32] = {}
    for stream, components in channels:
        if stream in streams and stream != Stream.POSITION_RESIDUAL:
            shape = (count, header.slots, components) if stream == Stream.OFFSETS else (count, components)
            values[stream] = np.empty(shape, np.float32)
    slots = header.slots if header.profile == Profile.ANCHOR else 0
    return Decoded(
        header,
        layers,
        load_models,
        attributes,
        np.empty(count, np.int32),
        np.empty(count, np.uint8),
        np.empty((count, 3)) if "positions" in attributes else None,
        values,
        np.empty((count, stages), np.int16) if "latents" in attributes else None,
        np.empty((count, slots), np.bool_),
    )

"""From an allocation to the :class:`QuantisedScene` that the writer takes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from reference_encoder.rdo.allocation import Allocation
from reference_encoder.rdo.lattice import Placement
from reference_encoder.rdo.rdo_input import RdoInput
from scarfmt.arrays import I32, I64
from scarfmt.blocks.mlp import QuantisedMlp
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import HeaderFields
from scarfmt.container.schema import ColourSpace, CoordinateFrame, Stream
from scarfmt.scene.model import SceneModel


def assemble_scene(
    problem: RdoInput,
    allocation: Allocation,
    metadata: Mapping[str, Any],
    mlps: tuple[QuantisedMlp, ...] = (),
    slot_layers: I64 | None = None,
) -> QuantisedScene:
    """All integers of a file.

    Args:
        metadata: JSON-able annotations.
        mlps: opacity, covariance and colour networks of the anchor profile.
        slot_layers: (N, K) layer that turns each slot on, 0 for never; None in the explicit profile.
    """
    model, placement = allocation.model, problem.placement
    return QuantisedScene(
        fields=header_fields(problem),
        model=model,
        tiles=placement.tiles,
        contents=cut_contents(model, placement, problem.classes.of, allocation.integers, slot_layers),
        decoder=problem.decoder if model.channel_index(Stream.LATENT) is not None else None,
        scene_mlps=mlps,
        metadata=dict(metadata),
    )


def header_fields(problem: RdoInput) -> HeaderFields:
    """The header fields that hold for the whole scene."""
    lattice = problem.placement.lattice
    return HeaderFields(
        problem.profile,
        problem.sh_degree,
        problem.slots,
        lattice.bits,
        lattice.origin,
        lattice.voxel,
        problem.source_count,
        CoordinateFrame.RDF,
        problem.description.colour_space or ColourSpace.SRGB,
        problem.description.render_model,
    )


def cut_contents(
    model: SceneModel,
    placement: Placement,
    classes: I64,
    integers: Mapping[Stream, I32],
    slot_layers: I64 | None = None,
) -> tuple[TileContent, ...]:
    """Tile contents in normative order (SPEC §6.3): by tile, layer of first appearance, Morton code, class.

    Args:
        placement: of N anchors.
        classes: (N,).
        integers: (N, components) int32 quantised values per channel.
        slot_layers: as :func:`assemble_scene` has it.
    """
    appears = np.searchsorted([row.class_count for row in model.layers], classes, side="right")
    order = np.lexsort((classes, placement.codes, appears, placement.tile))
    edges = np.cumsum(np.bincount(placement.tile, minlength=len(placement.tiles)))[:-1]
    contents = []
    for here in np.split(order, edges):
        content = TileContent.empty(model, len(here))
        content.codes, content.classes = placement.codes[here], classes[here]
        content.values = [integers[channel.stream][here] for channel in model.channels]
        if slot_layers is not None:
            content.slot_layers = slot_layers[here]
        contents.append(content)
    return tuple(contents)

"""From a decision to the :class:`QuantisedScene` that the writer takes (encoder side)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from reference_encoder.decide.decision import Decision
from reference_encoder.decide.lattice import Placement
from reference_encoder.decide.problem import Geometry, Problem
from reference_encoder.decide.targets import Targets
from scarfmt.arrays import I16, I64
from scarfmt.blocks.mlp import QuantisedMlp
from scarfmt.coding.tile import TileContent, first_values
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import HeaderFields
from scarfmt.container.schema import ColourSpace, CoordinateFrame, Stream
from scarfmt.scene.model import SceneModel


@dataclass(frozen=True)
class Quantised:
    """All integers of a file under static tables, and what its codewords are to reproduce.

    Attributes:
        scene: for the writer.
        targets: None keeps the indices as they are.
    """

    scene: QuantisedScene
    targets: Targets | None = None


def assembled(
    problem: Problem,
    decision: Decision,
    metadata: Mapping[str, Any],
    mlps: tuple[QuantisedMlp, ...] = (),
    slot_layers: I64 | None = None,
) -> Quantised:
    """The quantised scene of a file for `decision`.

    Args:
        metadata: JSON-able annotations.
        mlps: opacity, covariance and colour networks of the anchor profile.
        slot_layers: (N, K) layer that turns each slot on, 0 for never; None in the explicit profile.
    """
    model, fitted, geometry = decision.model, problem.fitted, problem.geometry
    stages = model.max_stages > 0
    refined = model.channel_index(Stream.LATENT) is not None
    scene = QuantisedScene(
        fields=header_fields(geometry),
        model=model,
        tiles=geometry.placement.tiles,
        contents=contents_of(
            model,
            geometry.placement,
            decision.classes,
            decision.finals,
            fitted.rvq.indices if fitted is not None and stages else None,
            slot_layers,
        ),
        codebooks=fitted.books if fitted is not None and stages else None,
        decoder=fitted.latent.decoder if fitted is not None and (stages or refined) else None,
        scene_mlps=mlps,
        metadata=dict(metadata),
    )
    if fitted is None:
        return Quantised(scene)
    order = anchor_order(model, geometry.placement, decision.classes)
    latent = fitted.latent
    return Quantised(scene, Targets(latent.values[order], latent.weight[order], problem.budget.lambda_))


def header_fields(geometry: Geometry) -> HeaderFields:
    """The header fields that hold for the whole scene."""
    lattice = geometry.placement.lattice
    return HeaderFields(
        geometry.profile,
        geometry.sh_degree,
        geometry.slots,
        lattice.bits,
        lattice.origin,
        lattice.voxel,
        geometry.source_count,
        CoordinateFrame.RDF,
        ColourSpace.SRGB,
    )


def anchor_order(model: SceneModel, placement: Placement, classes: I64) -> I64:
    """(N,) anchors as the contents of all tiles hold them, tile after tile (SPEC §6.3)."""
    appears = np.searchsorted([row.class_count for row in model.layers], classes, side="right")
    return np.lexsort((classes, placement.codes, appears, placement.tile))


def contents_of(
    model: SceneModel,
    placement: Placement,
    classes: I64,
    finals: Mapping[Stream, I64],
    indices: I16 | None,
    slot_layers: I64 | None = None,
) -> tuple[TileContent, ...]:
    """Tile contents in normative order (SPEC §6.3).

    Args:
        placement: of N anchors.
        classes: (N,).
        finals: (N, components) quantised values per channel.
        indices: (N, M) codewords, at least as many stages as the model has; None where it has none.
        slot_layers: as :func:`assembled` has it.
    """
    order = anchor_order(model, placement, classes)
    edges = np.cumsum(np.bincount(placement.tile, minlength=len(placement.tiles)))[:-1]
    stages, received = model.max_stages, model.stages(len(model.layers), classes)
    contents = []
    for here in np.split(order, edges):
        content = TileContent.empty(model, len(here))
        content.codes, content.classes = placement.codes[here], classes[here]
        content.values = [finals[channel.stream][here].astype(np.int32) for channel in model.channels]
        if indices is not None:
            chosen = indices[here, :stages]
            content.indices = np.where(np.arange(stages) < received[here, None], chosen, 0).astype(np.int16)
        if slot_layers is not None:
            content.slot_layers = slot_layers[here]
        content.first = first_values(model, content)
        contents.append(content)
    return tuple(contents)

"""The allocation of bits, shared by both profiles: layers, channels and final integers of one scene, and all that
the writer takes (:class:`QuantisedScene`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from reference_encoder.rdo.curves import RdCurve
from reference_encoder.rdo.lattice import Placement
from reference_encoder.rdo.layers import LayerChoice, Steps, price_layers
from reference_encoder.rdo.rdo_input import RdoInput
from reference_encoder.rdo.rounding import round_values
from scarfmt.arrays import F64, I32, I64, Floats
from scarfmt.blocks.mlp import QuantisedMlp
from scarfmt.codecs.channels import cell_widths
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import HeaderFields
from scarfmt.container.schema import ColourSpace, CoordinateFrame, Stream
from scarfmt.scene.model import Channel, LayerRow, SceneModel


@dataclass(frozen=True)
class Allocation:
    """The content of a file.

    Attributes:
        model: channels, classes and layers.
        integers: (N, components) int32 quantised values per channel.
        lambdas: of each layer that is kept.
    """

    model: SceneModel
    integers: Mapping[Stream, I32]
    lambdas: list[float]


def allocate(problem: RdoInput, curves: Sequence[RdCurve], choices: Sequence[LayerChoice]) -> Allocation:
    """Steps and classes of every layer, and the integers of the last.

    Args:
        problem, curves: what there is to decide, and what it costs.
        choices: what each layer shows, whole classes (:func:`reference_encoder.rdo.layers.split_classes`); layers that
            add nothing are left out.
    """
    costs = price_layers(problem, curves)
    rows: dict[tuple[Steps, ...], float] = {}
    for choice in choices:
        rows.setdefault(tuple(costs.steps(choice)), choice.lambda_)
    last, used, integers = list(rows)[-1], list[int](), dict[Stream, I32]()
    for index, curve in enumerate(curves):
        steps = np.array([row[index] for row in last])
        if not steps.any():
            continue
        used.append(index)
        values, weight = problem.values[curve.stream], problem.weights[curve.stream]
        received = curve.step, steps
        integers[curve.stream] = quantise_channel(values, weight, problem.classes.of, received, problem.lambda_)
    channels = tuple(Channel(curves[i].stream, curves[i].step) for i in used)
    kept = tuple(LayerRow((0,) * len(row), tuple(tuple(steps[i] for i in used) for steps in row)) for row in rows)
    model = SceneModel(problem.profile, problem.slots, channels, kept)
    return Allocation(model, integers, [*list(rows.values())[:-1], problem.lambda_])


def quantise_channel(
    values: Floats, weight: F64, classes: I64, received: tuple[Sequence[float], I64], lambda_: float
) -> I32:
    """(N, components) int32 integers of the last layer; 0 for classes that receive none.

    Args:
        values, weight: (N, components), true ones, and squared picture error per squared unit.
        classes: (N,).
        received: first width per component, and (classes,) steps.
        lambda_: of the last layer, squared picture error per bit.
    """
    step, steps = received
    final = round_values(values, weight, classes, lambda_, cell_widths(step, np.maximum(steps, 1)))
    if not steps.all():
        final *= (steps > 0)[classes, None]
    return final


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
        decoder=problem.latent.decoder if problem.latent and model.channel_index(Stream.LATENT) is not None else None,
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

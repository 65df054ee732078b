"""The scene that a file, or an early layer of one, will show, from the encoder's integers or values (SPEC §9)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from reference_decoder.reconstruct import (
    Codewords,
    anchor_model,
    channel_arrays,
    explicit_scene,
    positions,
    residuals,
)
from reference_encoder.rdo.curves import RdCurve
from reference_encoder.rdo.rdo_input import RdoInput
from scarfmt.arrays import F32, F64, I64
from scarfmt.codecs.channels import cell_widths
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.schema import Stream
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from scarfmt.scene.model import Lattice


def reconstruct_gaussians(scene: QuantisedScene) -> GaussianScene:
    """The Gaussians of the last layer of an explicit file, in file order."""
    at, values, codewords = _values(scene)
    fields = scene.fields
    return explicit_scene(at, values, fields.sh_degree, scene.decoder, codewords, Description.of_header(fields))


def reconstruct_anchors(scene: QuantisedScene) -> AnchorModel:
    """The model of the last layer of an anchor file, in file order."""
    at, values, codewords = _values(scene)
    assert scene.decoder is not None
    slots = np.concatenate([content.slot_layers > 0 for content in scene.contents])
    return anchor_model(at, values, slots, scene.decoder, scene.scene_mlps, codewords)


def reconstruct_preview(
    problem: RdoInput, curves: Sequence[RdCurve], steps: Sequence[Sequence[int]], parts: Sequence[float] | None = None
) -> GaussianScene:
    """About the Gaussians of a layer in which the first classes have received `steps`, values simply rounded.

    Args:
        problem, curves: what there is to decide, and first steps of all channels.
        steps: of each class that is there, those of each channel.
        parts: of each of these classes, what is there; None for all of them.
    """
    classes, placement = problem.classes, problem.placement
    here = np.flatnonzero(classes.shown([1.0] * len(steps) if parts is None else parts))
    received, values = np.array(steps), {}
    for index, curve in enumerate(curves):
        if received[:, index].any():
            widths = cell_widths(curve.step, received[:, index])
            values[curve.stream] = _round_values(problem.values[curve.stream], here, classes.of, widths)
    moved = values.get(Stream.POSITION_RESIDUAL, np.float32(0)) - placement.residual[here]
    at = problem.positions[here] + moved * placement.cell[here, None]
    values.setdefault(Stream.SCALE, np.zeros((len(here), 3), np.float32))
    decoder = problem.decoder if Stream.LATENT in values else None
    nothing = None, np.zeros((len(here), 0), np.int64), np.zeros(len(here), np.int64)
    return explicit_scene(at, values, problem.sh_degree, decoder, nothing, problem.description)


def _values(scene: QuantisedScene) -> tuple[F64, dict[Stream, F32], Codewords]:
    """(N, 3) positions, (N, components) of every channel, and the codewords of all anchors."""
    lattice = Lattice(scene.fields.origin, scene.fields.voxel, scene.fields.lattice_bits)
    model, contents = scene.model, scene.contents
    parts = [channel_arrays(model, content) for content in contents]
    values = {channel.stream: np.concatenate([part[channel.stream] for part in parts]) for channel in model.channels}
    places = zip(scene.tiles, contents, strict=True)
    at = [positions(lattice, tile, content.codes, residuals(model, content)) for tile, content in places]
    indices = np.concatenate([content.indices for content in contents])
    stages = model.stages(len(model.layers), np.concatenate([content.classes for content in contents]))
    return np.concatenate(at), values, (scene.codebooks, indices, stages)


def _round_values(true: F64, here: I64, classes: I64, widths: F64) -> F32:
    """(n, components) values of the anchors `here`, rounded to multiples of the widths of their classes; 0 for 0.

    Args:
        true: (N, components).
        here: (n,) rows of these.
        classes: (N,).
        widths: (classes, components).
    """
    width = widths[classes[here]]
    cells = np.divide(true[here], width, out=np.zeros(width.shape), where=width > 0)
    return np.asarray((np.rint(cells) * width).astype(np.float32))

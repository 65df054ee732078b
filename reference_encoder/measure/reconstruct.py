"""The scene a decoder will give for what was decided, before anything is coded (encoder side of SPEC §9).

To the rounding of binary32, which no picture shows: the encoder looks at it, nobody else does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from reference_encoder.decide.assemble import cell_widths
from reference_encoder.decide.decision import Decision, Plans, Problem, leading
from scarfmt.container.schema import Stream
from scarfmt.scene.activation import opacity_logits, spherical_harmonics_from_colour
from scarfmt.scene.codebooks import Codebooks
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.rotation import quaternion_from

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


def reconstructed(positions: F64, sh_degree: int, problem: Problem, decision: Decision) -> GaussianScene:
    """The Gaussians of the last layer of an explicit file.

    Args:
        positions: (N, 3) float64 true positions of the anchors of `problem`, in its order.
        sh_degree: of the file.
        problem, decision: what there was to decide, and what was.
    """
    model, last = decision.model, decision.model.layers[-1]
    steps, kinds = np.array(last.steps), decision.classes
    values = {
        channel.stream: decision.finals[channel.stream] * cell_widths(channel.first_width, steps[:, index])[kinds]
        for index, channel in enumerate(model.channels)
    }
    return _scene(positions, sh_degree, problem, values, np.array(last.stages)[kinds], np.arange(len(positions)))


def rough(
    positions: F64, sh_degree: int, problem: Problem, plans: Plans, entries: Sequence[Sequence[int]], part: float = 1.0
) -> GaussianScene:
    """About the Gaussians of a layer in which the first classes have received `entries`, values simply rounded.

    Args:
        positions, sh_degree, problem: as for :func:`reconstructed`.
        plans: first steps of all channels.
        entries: of each class that is there, stages, steps of each channel, and LATENT steps.
        part: of the last of these classes, the most important anchors.
    """
    last = len(entries) - 1
    here = np.flatnonzero((problem.classes < last) | leading(problem, last, part))
    received, kinds, values = np.array(entries), problem.classes[here], {}
    for index, plan in enumerate([*plans.channels, plans.latent], start=1):
        if received[:, index].any():
            true = plans.left if plan.stream == Stream.LATENT else problem.values[plan.stream]
            width = cell_widths(plan.step, received[:, index])
            values[plan.stream] = np.rint(true[here] * np.divide(1, width, where=width > 0, out=width * 0)[kinds])
            values[plan.stream] *= width[kinds]
    return _scene(positions, sh_degree, problem, values, received[kinds, 0], here)


def _scene(
    positions: F64, sh_degree: int, problem: Problem, values: Mapping[Stream, F64], stages: I64, here: I64
) -> GaussianScene:
    """The Gaussians of the anchors `here`; `values` and `stages` are theirs, what is not among `values` is 0."""
    place, count = problem.placement, len(here)
    rotation = values.get(Stream.ROTATION, np.zeros((count, 3)))
    moved = values.get(Stream.POSITION_RESIDUAL, 0.0) - place.residual[here]
    sh = np.zeros((count, (sh_degree + 1) ** 2, 3), np.float32)
    sh[:, 0] = spherical_harmonics_from_colour(values.get(Stream.COLOUR, np.zeros((count, 3))))
    if problem.latent is not None and problem.rvq is not None and (stages.any() or Stream.LATENT in values):
        z = Codebooks(problem.rvq.coarse, problem.rvq.residual).latents(problem.rvq.indices[here], stages)
        refined = z + values.get(Stream.LATENT, 0.0)
        told = refined.any(axis=1)
        rest = np.repeat(problem.latent.decoder.apply(np.zeros((1, z.shape[1]))), count, axis=0)
        rest[told] = problem.latent.decoder.apply(refined[told])
        sh[:, 1:] = rest.reshape(count, -1, 3)
    return GaussianScene(
        positions[here] + moved * place.cell[here, None],
        values.get(Stream.SCALE, np.zeros((count, 3))).astype(np.float32),
        quaternion_from(rotation[:, :2], rotation[:, 2]).astype(np.float32),
        opacity_logits(values.get(Stream.OPACITY, np.zeros((count, 1)))[:, 0]).astype(np.float32),
        sh,
    )

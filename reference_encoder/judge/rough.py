"""About the scene that an early layer will show, before anything is decided (encoder side of SPEC §9)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from reference_encoder.decide.plans import Plans
from reference_encoder.decide.problem import Problem
from reference_encoder.judge.values import applied, codeword_sums, rounded
from scarfmt.arrays import F32, I64
from scarfmt.codecs.channels import cell_widths
from scarfmt.container.schema import Stream
from scarfmt.scene.activation import activated
from scarfmt.scene.gaussians import GaussianScene


def rough(
    problem: Problem, plans: Plans, entries: Sequence[Sequence[int]], parts: Sequence[float] | None = None
) -> GaussianScene:
    """About the Gaussians of a layer in which the first classes have received `entries`, values simply rounded.

    Args:
        problem, plans: what there is to decide, and first steps of all channels.
        entries: of each class that is there, stages, steps of each channel, and LATENT steps.
        parts: of each of these classes, what is there; None for all of them.
    """
    classes = problem.classes
    here = np.flatnonzero(classes.shown([1.0] * len(entries) if parts is None else parts))
    received, of, values = np.array(entries), classes.of[here], {}
    for index, plan in enumerate([*plans.channels, plans.latent], start=1):
        if received[:, index].any():
            true = plans.left if plan.stream == Stream.LATENT else problem.channels.values[plan.stream]
            values[plan.stream] = rounded(true, here, classes.of, cell_widths(plan.step, received[:, index]))
    return _scene(problem, values, received[of, 0], here)


def _scene(problem: Problem, values: Mapping[Stream, F32], stages: I64, here: I64) -> GaussianScene:
    """The Gaussians of the anchors `here`; `values` and `stages` are theirs, what is not among `values` is 0."""
    geometry, count = problem.geometry, len(here)
    place, degree = geometry.placement, geometry.sh_degree
    moved = values.get(Stream.POSITION_RESIDUAL, np.float32(0)) - place.residual[here]
    rotations, logits, colours = activated(values, count, np.float32)
    sh = np.zeros((count, (degree + 1) ** 2, 3), np.float32)
    sh[:, 0] = colours
    if problem.fitted is not None and (stages.any() or Stream.LATENT in values):
        sh[:, 1:] = _rest(problem, values.get(Stream.LATENT), stages, here).reshape(count, -1, 3)
    return GaussianScene(
        geometry.positions[here] + moved * place.cell[here, None],
        values.get(Stream.SCALE, np.zeros((count, 3), np.float32)),
        rotations.astype(np.float32),
        logits.astype(np.float32),
        sh,
    )


def _rest(problem: Problem, refined: F32 | None, stages: I64, here: I64) -> F32:
    """(n, outputs) of the latent decoder for the anchors `here`."""
    assert problem.fitted is not None
    decoder = problem.fitted.latent.decoder
    z = codeword_sums(problem.fitted.books, problem.fitted.rvq.indices[here], stages)
    if refined is not None:
        z += refined
    rest = np.empty((len(z), decoder.outputs), np.float32)
    applied(decoder, z, rest)
    return rest

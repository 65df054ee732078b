"""About the scene that an early layer will show, before anything is decided (encoder side of SPEC §9)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from reference_encoder.decide.plans import Plans
from reference_encoder.decide.problem import Problem
from scarfmt.arrays import F64, I64
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
            width = cell_widths(plan.step, received[:, index])
            values[plan.stream] = np.rint(true[here] * np.divide(1, width, where=width > 0, out=width * 0)[of])
            values[plan.stream] *= width[of]
    return _scene(problem, values, received[of, 0], here)


def _scene(problem: Problem, values: Mapping[Stream, F64], stages: I64, here: I64) -> GaussianScene:
    """The Gaussians of the anchors `here`; `values` and `stages` are theirs, what is not among `values` is 0."""
    geometry, count = problem.geometry, len(here)
    place, degree = geometry.placement, geometry.sh_degree
    moved = values.get(Stream.POSITION_RESIDUAL, 0.0) - place.residual[here]
    rotations, logits, colours = activated(values, count, np.float64)
    sh = np.zeros((count, (degree + 1) ** 2, 3), np.float32)
    sh[:, 0] = colours
    if problem.fitted is not None and (stages.any() or Stream.LATENT in values):
        sh[:, 1:] = _rest(problem, values.get(Stream.LATENT), stages, here).reshape(count, -1, 3)
    return GaussianScene(
        geometry.positions[here] + moved * place.cell[here, None],
        values.get(Stream.SCALE, np.zeros((count, 3))).astype(np.float32),
        rotations.astype(np.float32),
        logits.astype(np.float32),
        sh,
    )


def _rest(problem: Problem, refined: F64 | None, stages: I64, here: I64) -> F64:
    """(n, outputs) of the latent decoder for the anchors `here`; those of a latent of 0 are computed once."""
    assert problem.fitted is not None
    decoder = problem.fitted.latent.decoder
    summed = problem.fitted.books.latents(problem.fitted.rvq.indices[here], stages)
    z = summed + (np.float64(0) if refined is None else refined)
    told = z.any(axis=1)
    rest = np.repeat(decoder.apply(np.zeros((1, z.shape[1]))), len(here), axis=0)
    rest[told] = decoder.apply(z[told])
    return np.asarray(rest)

"""Some Gaussians of every range, for what is decided about all (encoder only)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from reference_encoder.scale.glance import Overview, joined
from reference_encoder.scale.steps import Measured, Range, Sample
from reference_encoder.tuning import CLASS_COLOUR_SHARE, IMPORTANCE_RATIO, SAMPLE_ROWS
from scarfmt.arrays import I64
from scarfmt.scene.gaussians import GaussianScene


def sample(overview: Overview, part: Range, scene: GaussianScene, measured: Measured) -> Sample:
    """Gaussians of a range: of every range the same share, and of each level of importance, evenly spread in space.

    The few that weigh most open classes of their own, so that each range sends one of its highest level.

    Args:
        overview: of the whole scene.
        part: the range.
        scene, measured: its Gaussians, and what they weigh.
    """
    order = np.lexsort((overview.bounds.paths(scene.positions), -levels(measured, scene.sh_degree)))
    step = max(overview.bounds.count / SAMPLE_ROWS, 1.0)
    chosen = order[np.arange(0, len(order), step).astype(np.int64)]
    return Sample(scene.take(chosen), rows_of(measured, chosen), len(scene))


def levels(measured: Measured, sh_degree: int) -> I64:
    """(n,) about the classes of importance that Gaussians will be in, the highest the most important."""
    share = CLASS_COLOUR_SHARE if sh_degree else 0.0
    shape, colour = (np.log(np.maximum(each.astype(np.float64), 1e-30)) for each in (measured.shape, measured.colour))
    found: I64 = np.floor(((1 - share) * shape + share * colour) / np.log(IMPORTANCE_RATIO)).astype(np.int64)
    return found


def rows_of(measured: Measured, chosen: I64) -> Measured:
    """Select some Gaussians."""
    return Measured(*(values[chosen] for values in vars(measured).values()))


def joined_samples(samples: Sequence[Sample]) -> Sample:
    """The samples of several ranges as one."""
    parts = [vars(each.measured).values() for each in samples]
    measured = Measured(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    return Sample(joined([each.scene for each in samples]), measured, sum(each.count for each in samples))

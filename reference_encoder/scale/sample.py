"""Some Gaussians of every range, for what is decided about all (encoder only)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from reference_encoder.scale.glance import Overview, drawn_evenly, joined
from reference_encoder.scale.steps import Measured, Range, Sample
from reference_encoder.tuning import SAMPLE_ROWS
from scarfmt.arrays import I64
from scarfmt.scene.gaussians import GaussianScene


def sample(overview: Overview, part: Range, scene: GaussianScene, measured: Measured) -> Sample:
    """Gaussians of a range, evenly spread in space: of every range the same share.

    Args:
        overview: of the whole scene.
        part: the range.
        scene, measured: its Gaussians, and what they weigh.
    """
    order = np.argsort(overview.bounds.paths(scene.positions), kind="stable")
    share = SAMPLE_ROWS / overview.bounds.count
    chosen = order[drawn_evenly(len(order), share, overview.options.seed + part.number)]
    return Sample(scene.take(chosen), rows_of(measured, chosen), len(scene))


def rows_of(measured: Measured, chosen: I64) -> Measured:
    """Those of some Gaussians."""
    return Measured(*(values[chosen] for values in vars(measured).values()))


def joined_samples(samples: Sequence[Sample]) -> Sample:
    """The samples of several ranges as one."""
    parts = [vars(each.measured).values() for each in samples]
    measured = Measured(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    return Sample(joined([each.scene for each in samples]), measured, sum(each.count for each in samples))

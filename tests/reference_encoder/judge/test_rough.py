"""Layers before anything is decided about them."""

from __future__ import annotations

import numpy as np

from reference_encoder.judge.rough import rough
from reference_encoder.options import EncodeOptions
from reference_encoder.pipeline import attempted
from reference_encoder.profiles.explicit import ExplicitProfile
from reference_encoder.tuning import NEIGHBOURS
from tests.render.scenes import random_scene


def test_rough_layers_hold_the_classes_they_say() -> None:
    """A rough scene has the anchors of the first classes, and of each class the given part."""
    options = EncodeOptions(quality=45, effort=1, layers=2, corrections=0)
    tried = attempted(ExplicitProfile.measured(random_scene(2, 900, 1), options), 45)
    entry = (0, *(2 for _ in tried.plans.channels), 0)
    sizes = np.bincount(tried.problem.classes.of)
    whole = rough(tried.problem, tried.plans, [entry] * 2)
    half = rough(tried.problem, tried.plans, [entry] * 2, (1.0, 0.5))
    assert len(whole) == sizes[:2].sum()
    assert abs(len(half) - sizes[0] - sizes[1] / 2) <= NEIGHBOURS / 2
    assert not whole.sh[:, 1:].any()

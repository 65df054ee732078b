"""The weight of each Gaussian without a survey: by its size and opacity alone (encoder only, informative)."""

from __future__ import annotations

import numpy as np

from reference_encoder.importance.view_sampling import SurveyViews
from reference_encoder.importance.weights import PIXEL, Weights, weigh_unoccluded
from reference_encoder.tuning import DRAFT_GAUSSIANS, FLOOR_DISTANCE
from scarfmt.scene.gaussians import GaussianScene


def weigh_draft(scene: GaussianScene, survey: SurveyViews) -> Weights:
    """The weights of Gaussians that nobody has looked at: as if nothing were in front of any of them.

    Args:
        scene: all of it, or a part.
        survey: without views; of the whole scene.
    """
    near = FLOOR_DISTANCE * survey.radius
    floor = weigh_unoccluded(scene, near, DRAFT_GAUSSIANS)
    return Weights({}, {}, floor, np.full(len(scene), near * PIXEL, np.float32), np.ones(len(scene), np.float32))

"""The account of a scene's Gaussians: how many were left out, and how many were made coarse (encoder side)."""

from __future__ import annotations

from typing import Any

import numpy as np

from reference_encoder.decide.decision import Decision
from reference_encoder.measure.survey import Survey
from reference_encoder.tuning import INVISIBLE_WEIGHT
from scarfmt.arrays import F32, Bools
from scarfmt.container.schema import Stream

ACCOUNT = "survey"
"""The member of METADATA."""


def account(survey: Survey, largest: F32, left_out: Bools, decision: Decision, view_dependent: bool) -> dict[str, Any]:
    """JSON-able member of METADATA: how the scene was looked at, and what of it is not in the file as it was.

    Args:
        survey: the views.
        largest: (N,) largest blending weight of each Gaussian in any of their pixels.
        left_out: (N,) whether it is not in the file.
        decision: of the others.
        view_dependent: whether the source has view-dependent colour.
    """
    invisible = largest < INVISIBLE_WEIGHT
    found: dict[str, Any] = {
        "up": survey.up.up,
        "up_detected": not survey.up.given,
        "radius": float(f"{survey.radius:.3g}"),
        "views": {kind: len(cameras) for kind, cameras in survey.views.items()},
        "left_out": {"invisible": int((left_out & invisible).sum()), "faint": int((left_out & ~invisible).sum())},
    }
    if survey.up.other is not None:
        found["up_or"] = survey.up.other
    if view_dependent:
        found["without_view_dependence"] = int((~_view_dependent(decision)).sum())
    return found


def _view_dependent(decision: Decision) -> Bools:
    """(n,) whether each anchor of the file has any colour beyond degree 0."""
    last, index = decision.model.layers[-1], decision.model.channel_index(Stream.LATENT)
    refined = np.array([0 if index is None else steps[index] for steps in last.steps])
    return np.asarray(((np.array(last.stages) + refined) > 0)[decision.classes])

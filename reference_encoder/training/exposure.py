"""The exposures of photos: a gain and an offset a channel, applied to a picture before it meets its photo.

Those of each photo are fitted by least squares whenever it is learnt from. Their mean over photos is the identity, as
which the file has the scene. Photos that hardly differ are left as they are: what the fit then finds is what pictures
still lack.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from reference_encoder.training.fixed_order import mean, sum_over_rows
from reference_encoder.training.similarity import intensities

LIMIT = 0.06
"""Root mean squared change of middle grey, relative, from which on exposures are applied: 0.02 to 0.03 are found of
captures that hardly differ, 0.2 of gains between 0.7 and 1.4."""
_SHRINKAGE = 0.01
"""Price of squared gains and offsets, in squared errors of a pixel."""
_PACE = 0.3
"""Share of a new fit in what is kept."""


@torch.no_grad()
def fit_exposure(exposures: Tensor, number: int, picture: Tensor, photo: Tensor) -> None:
    """Move one of (n, 2, 3) float32 `exposures`, gains less 1 and offsets, towards the least squares of every fourth
    pixel, and all to a mean of 0.

    Args:
        number: of the photo.
        picture: (H, W, 3) without any exposure.
        photo: (H, W, 3) uint8.
    """
    shown = picture[::2, ::2].reshape(-1, 3)
    lacks = intensities(photo[::2, ::2]).reshape(-1, 3) - shown
    moments = sum_over_rows(torch.cat([shown, shown * shown, lacks, shown * lacks], dim=1)) / len(shown)
    once, square, offset, product = moments.double().chunk(4)
    square, one = square + _SHRINKAGE, 1 + _SHRINKAGE
    fit = torch.stack([one * product - once * offset, square * offset - once * product]) / (one * square - once**2)
    exposures[number] += _PACE * (fit.float() - exposures[number])
    exposures -= sum_over_rows(exposures.flatten(1)).view(2, 3) / len(exposures)


def spread(exposures: Tensor) -> float:
    """Root mean squared change of middle grey by (n, 2, 3) exposures, relative."""
    return math.sqrt(float(mean((exposures[:, 0] + 2 * exposures[:, 1]) ** 2)))


def expose(exposures: Tensor, number: int, picture: Tensor) -> Tensor:
    """(H, W, 3) picture as photo `number` has it; where exposures hardly differ, as it is."""
    if spread(exposures) < LIMIT:
        return picture
    gain, offset = exposures[number]
    exposed: Tensor = picture * (1 + gain) + offset
    return exposed

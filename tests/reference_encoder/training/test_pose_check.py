"""Pictures beside their photos are noticed: to a fraction of a pixel, and only where all of a picture is off."""

import math
import warnings

import numpy as np
import pytest
import torch
from torch import Tensor

from reference_encoder.training.pose_check import LIMIT, displacement, warn_of_displacement
from reference_encoder.training.similarity import blur
from scarfmt.errors import InputWarning

HEIGHT, WIDTH = 150, 180


def scenery(seed: int = 0, size: tuple[int, int] = (HEIGHT, WIDTH)) -> Tensor:
    """(H, W, 3) uint8 with structure of some pixels."""
    noise = torch.rand(*size, 1, generator=torch.Generator().manual_seed(seed))
    smooth = blur(blur(noise)).expand(-1, -1, 3)
    return ((smooth - smooth.min()) / (smooth.max() - smooth.min()) * 255).to(torch.uint8)


def moved(photo: Tensor, right: float, down: float) -> Tensor:
    """(H, W, 3) float32, a photo moved by fractions of pixels."""
    x = 2 * np.pi * (np.fft.fftfreq(photo.shape[1])[None, :] * right + np.fft.fftfreq(photo.shape[0])[:, None] * down)
    spectrum = np.fft.fft2(photo.numpy() / 255.0, axes=(0, 1)) * np.exp(-1j * x)[:, :, None]
    return torch.from_numpy(np.fft.ifft2(spectrum, axes=(0, 1)).real.copy()).float()


@pytest.mark.parametrize(("right", "down"), [(0, 0), (2, 0), (0, -3), (0.5, 0.25), (-1.75, 2.5)])
def test_how_far_a_picture_lies_beside_its_photo(right: float, down: float) -> None:
    photo = scenery()
    found = displacement([(moved(photo, right, down), photo)])
    assert found == pytest.approx(math.hypot(right, down), abs=0.08)


def test_light_and_blur_do_not_matter() -> None:
    """The learnt picture is duller than its photo, and softer."""
    photo = scenery(1)
    dull = blur(0.6 * moved(photo, 1, 0) + 0.1)
    assert displacement([(dull, photo)]) == pytest.approx(1, abs=0.15)


def test_pictures_that_go_different_ways_do_not_cancel() -> None:
    photos = [scenery(seed) for seed in range(2)]
    pairs = [(moved(photo, right, 0), photo) for photo, right in zip(photos, (2, -2), strict=True)]
    assert displacement(pairs) == pytest.approx(2, abs=0.1)


def test_a_part_that_moved_does_not_count() -> None:
    """A cloth that was moved between photos is no fault of their poses."""
    photo = scenery(2)
    torn = torch.cat([moved(photo, 3, 0)[:40], moved(photo, 0, 0)[40:]], dim=0)
    assert displacement([(torn, photo)]) < 0.1


@pytest.mark.parametrize("size", [(20, 400), (60, 60)])
def test_what_cannot_be_told_apart_is_no_number(size: tuple[int, int]) -> None:
    """Pictures smaller than the blocks, of too few of them, and of one colour."""
    photo = scenery(0, size)
    assert math.isnan(displacement([(photo.float() / 255, photo)]))
    flat = torch.full((HEIGHT, WIDTH, 3), 128, dtype=torch.uint8)
    assert math.isnan(displacement([(flat.float() / 255, flat)]))
    assert math.isnan(displacement([]))


def test_a_warning_names_the_distance_and_a_way_out() -> None:
    with pytest.warns(InputWarning, match=r"0\.84 pixels.*photos alone"):
        warn_of_displacement(0.84)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_displacement(LIMIT)
        warn_of_displacement(math.nan)

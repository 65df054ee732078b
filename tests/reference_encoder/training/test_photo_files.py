"""Photos made smaller keep the light that falls on every part of them."""

from __future__ import annotations

import numpy as np

from reference_encoder.training.photo_files import filter_areas


def test_boxes_that_divide_are_averaged() -> None:
    """Rounded to nearest, as notes of cameras' sizes assume: pixel edges stay where they are."""
    picture = np.random.default_rng(0).integers(0, 256, (12, 8, 3), dtype=np.uint8)
    expected = picture.reshape(6, 2, 4, 2, 3).mean(axis=(1, 3))
    np.testing.assert_array_equal(filter_areas(picture, 4, 6), np.floor(expected + 0.5))


def test_parts_of_pixels_count_in_part() -> None:
    """Three pixels to two: the middle one is shared."""
    row = np.array([[[0] * 3, [90] * 3, [240] * 3]], np.uint8)
    np.testing.assert_array_equal(filter_areas(row, 2, 1)[0, :, 0], [30, 190])


def test_a_picture_of_the_size_stays_and_extremes_too() -> None:
    white = np.full((37, 53, 3), 255, np.uint8)
    assert filter_areas(white, 53, 37) is white
    assert (filter_areas(white, 20, 14) == 255).all()
    assert (filter_areas(0 * white, 20, 14) == 0).all()

"""Photos made smaller keep the light that falls on every part of them; none is left out without a word."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from reference_encoder.training.photo_files import bare_photos, filter_areas, warn_of_unread
from scarfmt.errors import LossWarning


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


def test_photos_of_kinds_that_are_not_read_are_named(tmp_path: Path) -> None:
    """Beside those that are read; other files of a folder are nobody's photos."""
    for name in ("a.jpg", "b.HEIC", "c.dng", "notes.txt"):
        (tmp_path / name).touch()
    assert [file.name for file in bare_photos(tmp_path)] == ["a.jpg"]
    with pytest.warns(LossWarning, match=r"b\.HEIC, c\.dng: of a kind that is not read"):
        warn_of_unread(tmp_path)

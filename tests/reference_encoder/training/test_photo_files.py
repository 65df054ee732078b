"""Photos made smaller keep the light that falls on every part of them; none is left out without a word."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from reference_encoder.training.photo_files import bare_photos, filter_areas, upright_photos, warn_of_unread
from scarfmt.errors import LossWarning
from scarfmt.render.images import read_pixels


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
    for name in ("a.jpg", "b.dng", "notes.txt"):
        (tmp_path / name).touch()
    assert [file.name for file in bare_photos(tmp_path)] == ["a.jpg"]
    with pytest.warns(LossWarning, match=r"b\.dng: of a kind that is not read"):
        warn_of_unread(tmp_path)


def test_turned_photos_and_those_that_colmap_may_not_read_become_upright_pngs(tmp_path: Path) -> None:
    """As they are seen; the others stay the files that they are."""
    picture = np.zeros((40, 60, 3), np.uint8)
    picture[:20, :30] = 255
    turned = Image.Exif()
    turned[ExifTags.Base.Orientation] = 6  # to be turned a quarter clockwise
    image = Image.fromarray(picture)
    image.save(tmp_path / "a.jpg")
    image.save(tmp_path / "b.jpg", exif=turned)
    image.save(tmp_path / "c.webp", lossless=True)
    plain, upright, webp = upright_photos(bare_photos(tmp_path), tmp_path / "made")
    assert plain == tmp_path / "a.jpg"
    np.testing.assert_array_equal(read_pixels(upright) > 128, np.rot90(picture, -1) > 128)
    np.testing.assert_array_equal(read_pixels(webp), picture)


def test_heic_photos_are_read(tmp_path: Path) -> None:
    pillow_heif = pytest.importorskip("pillow_heif")
    picture = np.random.default_rng(0).integers(0, 256, (8, 12, 1), np.uint8).repeat(8, 0).repeat(8, 1).repeat(3, 2)
    pillow_heif.from_pillow(Image.fromarray(picture)).save(tmp_path / "a.HEIC", quality=100)
    (file,) = upright_photos(bare_photos(tmp_path), tmp_path / "made")
    assert np.abs(read_pixels(file).astype(int) - picture).mean() < 8

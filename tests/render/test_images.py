"""Pictures survive the way to disk, and a failed write leaves nothing behind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from scarfmt.render.images import contact_sheet, read_image, read_pixels, to_bytes, write_png
from tests.samples.codec_samples import refuses


def test_png_round_trip_is_exact_to_8_bits(tmp_path: Path) -> None:
    image = np.random.default_rng(0).uniform(0, 1, (7, 9, 3)).astype(np.float32)
    write_png(tmp_path / "a.png", image)
    assert np.array_equal(to_bytes(read_image(tmp_path / "a.png")), to_bytes(image))
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


def test_out_of_range_values_do_not_wrap_around() -> None:
    values = np.array([[[-3.0, 4.0, np.nan], [np.inf, -np.inf, 0.5]]])
    assert to_bytes(values).tolist() == [[[0, 255, 0], [255, 0, 128]]]


def test_failed_write_keeps_the_old_picture_and_no_rubbish(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    write_png(path, np.zeros((2, 2, 3)))
    before = path.read_bytes()
    with pytest.raises((TypeError, ValueError)):
        write_png(path, np.zeros((2, 2, 7)))
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.png"]


def test_what_is_transparent_shows_black(tmp_path: Path) -> None:
    """Whatever colour lies beneath; half of it in between, rounded."""
    pixels = np.array([[[200, 100, 50, 255], [200, 100, 50, 0], [200, 101, 50, 128]]], np.uint8)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    assert read_pixels(tmp_path / "a.png").tolist() == [[[200, 100, 50], [0, 0, 0], [100, 51, 25]]]


def test_pictures_of_16_bits_are_refused_rather_than_clipped(tmp_path: Path) -> None:
    Image.fromarray(np.full((2, 3), 300, np.uint16)).save(tmp_path / "a.png")
    refuses("input-image", lambda: read_pixels(tmp_path / "a.png"), "more than 8 bits")


@pytest.mark.parametrize("ending", ["png", "jpg"])
def test_pictures_cut_anywhere_are_refused(tmp_path: Path, ending: str) -> None:
    """Never another exception, and never the part that is there."""
    path = tmp_path / f"a.{ending}"
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (40, 30, 3), np.uint8)).save(path)
    whole = path.read_bytes()
    for length in range(0, len(whole) - 20, 31):
        path.write_bytes(whole[:length])
        refuses("input-image", lambda: read_pixels(path))


def test_the_note_of_how_to_turn_a_photo_is_ignored(tmp_path: Path) -> None:
    """Poses are of the pixels as they are stored."""
    turned = Image.Exif()
    turned[0x0112] = 6
    Image.new("RGB", (30, 20)).save(tmp_path / "a.jpg", exif=turned)
    assert read_pixels(tmp_path / "a.jpg").shape == (20, 30, 3)


def test_contact_sheet_places_pictures_row_by_row() -> None:
    images = [np.full((4, 6, 3), level, np.float32) for level in (0.2, 0.4, 0.6, 0.8, 1.0)]
    sheet = contact_sheet(images, columns=3)
    assert sheet.shape == (8, 18, 3)
    np.testing.assert_allclose(sheet[1, [1, 7, 13], 0], [0.2, 0.4, 0.6], atol=0.01)
    np.testing.assert_allclose(sheet[5, [1, 7, 13], 0], [0.8, 1.0, 0.0], atol=0.01)


def test_contact_sheet_writes_labels_under_the_pictures() -> None:
    images = [np.zeros((30, 60, 3), np.float32)] * 2
    sheet = contact_sheet(images, ["left", ""])
    assert sheet[:30].max() == 0
    assert sheet[30:, :60].max() > 0.5
    assert sheet[30:, 60:].max() == 0


@pytest.mark.parametrize(
    ("images", "labels"),
    [([], []), ([np.zeros((2, 2, 3)), np.zeros((3, 2, 3))], []), ([np.zeros((2, 2, 3))], ["a", "b"])],
)
def test_contact_sheets_that_cannot_be_are_refused(images: list, labels: list) -> None:
    refuses("input-shape", lambda: contact_sheet(images, labels))

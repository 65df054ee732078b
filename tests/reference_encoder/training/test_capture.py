"""Captures: the same photos, poses and points from every program's folder. A capture that cannot be used is refused in
one line."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from reference_encoder.training.capture import Capture, draw_points, load_capture, pixels
from scarfmt.errors import InputWarning, InvalidInput
from scarfmt.render.camera import in_view, look_at
from tests.reference_encoder.training import captures
from tests.reference_encoder.training.captures import HEIGHT, PHOTOS, WIDTH, cameras, scene
from tests.samples.codec_samples import refuses

FORMATS: dict[str, Callable[[Path], Path]] = {
    "own": captures.own,
    "COLMAP binary": lambda folder: captures.colmap(folder, "bin"),
    "COLMAP text": lambda folder: captures.colmap(folder, "txt"),
    "Nerfstudio": captures.nerfstudio,
}


def load_silently(path: Path, **options: Any) -> Capture:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return load_capture(path, **options)


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_gives_the_same_capture(kind: str, tmp_path: Path) -> None:
    capture = load_silently(FORMATS[kind](tmp_path))
    for photo, camera in zip(capture.photos, captures.cameras(), strict=True):
        np.testing.assert_allclose(photo.camera.world_to_camera, camera.world_to_camera, atol=1e-9)
        assert (photo.camera.width, photo.camera.fx) == (camera.width, pytest.approx(camera.fx))
        np.testing.assert_array_equal(pixels(photo), captures.photo(camera))
    np.testing.assert_array_equal(capture.points, captures.points()[0])
    assert [photo.camera.split for photo in capture.photos] == ["test"] + ["train"] * (PHOTOS - 1)


def test_blender_has_a_file_for_each_split_and_black_behind(tmp_path: Path) -> None:
    with pytest.warns(InputWarning, match="has no points to start from"):
        capture = load_capture(captures.blender(tmp_path))
    assert [photo.path.name for photo in capture.test] == ["photo0.png"]
    assert len(capture.train) == PHOTOS - 1
    expected = captures.photo(captures.cameras()[0])
    expected[0, 0] = 0
    np.testing.assert_array_equal(pixels(capture.test[0]), expected)
    assert len(capture.points) > 1000


def test_a_sparse_folder_finds_its_photos_above(tmp_path: Path) -> None:
    captures.colmap(tmp_path, "bin")
    assert load_silently(tmp_path / "sparse" / "0").digest == load_silently(tmp_path).digest


def test_a_resolution_makes_photos_and_cameras_smaller(tmp_path: Path) -> None:
    captures.own(tmp_path)
    half = load_silently(tmp_path, resolution=WIDTH // 2)
    for photo, camera in zip(half.photos, captures.cameras(), strict=True):
        assert (photo.camera.width, photo.camera.height) == (WIDTH // 2, HEIGHT // 2)
        assert photo.camera.fx == pytest.approx(camera.fx / 2)
        assert pixels(photo).shape == (HEIGHT // 2, WIDTH // 2, 3)
    assert load_silently(tmp_path, resolution=4 * WIDTH).digest == load_silently(tmp_path).digest != half.digest


def test_photos_of_different_sizes_are_used_where_each_camera_has_its_photos_size(tmp_path: Path) -> None:
    mixed = [*captures.cameras()[:4], *(replace(c, name=f"z{c.name}") for c in captures.cameras(30, 40)[4:])]
    capture = load_silently(captures.own(tmp_path, mixed))
    assert [pixels(photo).shape[:2] for photo in capture.photos] == [(HEIGHT, WIDTH)] * 4 + [(40, 30)] * 4
    small = load_silently(tmp_path, resolution=20)
    assert {max(pixels(photo).shape) for photo in small.photos} == {20}


@pytest.mark.parametrize(("hold_out", "expected"), [(0, []), (2, [0, 2, 4, 6]), (3, [0, 3, 6]), (100, [0])])
def test_every_nth_photo_by_name_is_held_out(tmp_path: Path, hold_out: int, expected: list[int]) -> None:
    capture = load_silently(captures.own(tmp_path, captures.cameras()[::-1]), hold_out=hold_out)
    assert [index for index, photo in enumerate(capture.photos) if photo.camera.split == "test"] == expected
    assert len(capture.train) + len(capture.test) == PHOTOS


def test_a_split_of_the_file_goes_before(tmp_path: Path) -> None:
    """An explicit request to hold out no photo goes before the split of the file."""
    views = [replace(camera, split="test" if index == 5 else "") for index, camera in enumerate(captures.cameras())]
    captures.own(tmp_path, views)
    assert [photo.path.name for photo in load_silently(tmp_path, hold_out=2).test] == ["photo5.png"]
    assert load_silently(tmp_path, hold_out=0).test == ()


def test_one_black_photo_is_left_out_with_a_warning(tmp_path: Path) -> None:
    blacken(captures.own(tmp_path), [2])
    Image.new("RGB", (WIDTH, HEIGHT), (20, 0, 0)).save(tmp_path / "images" / "photo3.png")  # dark is not black
    with pytest.warns(InputWarning, match=r"left out photo2\.png: black all over"):
        capture = load_capture(tmp_path)
    assert len(capture.photos) == PHOTOS - 1


def test_another_capture_has_another_digest(tmp_path: Path) -> None:
    captures.own(tmp_path)
    digests = [load_silently(tmp_path).digest, load_silently(tmp_path, hold_out=3).digest]
    document = json.loads((tmp_path / "cameras.json").read_text())
    document["images"][3]["world_to_camera"][0][3] += 1e-6
    for name, data in (
        ("cameras.json", json.dumps(document).encode()),
        ("points3d.ply", captures.ply(captures.points()[0] + 1, None)),
        ("images/photo1.png", (tmp_path / "images" / "photo1.png").read_bytes() + b" "),
    ):
        (tmp_path / name).write_bytes(data)
        digests.append(load_silently(tmp_path).digest)
    assert len(set(digests)) == 5
    (tmp_path / "points3d.ply").write_bytes(captures.ply(np.zeros((0, 3)), None))
    with pytest.warns(InputWarning, match="has no points to start from"):
        assert len(load_capture(tmp_path).points) > 1000


# Captures that cannot be used


def blacken(folder: Path, which: list[int] | range) -> None:
    for index in which:
        Image.new("RGB", (WIDTH, HEIGHT)).save(folder / "images" / f"photo{index}.png")


def edit(folder: Path, change: Callable[[list[dict[str, Any]]], object]) -> None:
    """Change the entries of cameras.json."""
    document = json.loads((folder / "cameras.json").read_text())
    change(document["images"])
    (folder / "cameras.json").write_text(json.dumps(document))


def as_jpeg(folder: Path, cut: int | None) -> None:
    """The second photo as a JPEG, perhaps cut short."""
    target = folder / "images" / "photo1.jpg"
    Image.open(folder / "images" / "photo1.png").save(target)
    edit(folder, lambda entries: entries[1].update(name="photo1.jpg"))
    target.write_bytes(target.read_bytes()[:cut])


def in_16_bits(folder: Path) -> None:
    Image.fromarray(np.zeros((HEIGHT, WIDTH), np.uint16)).save(folder / "images" / "photo1.png")


def points_at_nan(folder: Path) -> None:
    (folder / "points3d.ply").write_bytes(captures.ply(np.full((3, 3), np.nan), None))


BAD: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "one photo": (lambda folder: edit(folder, lambda e: e.__delitem__(slice(1, None))), "input-capture", "1 photo;"),
    "another size": (
        lambda folder: Image.new("RGB", (WIDTH, 7)).save(folder / "images" / "photo3.png"),
        "input-capture",
        "photo3.png has 48x7 pixels, but its camera 48x36",
    ),
    "missing photos": (
        lambda folder: [(folder / "images" / f"photo{index}.png").unlink() for index in range(5)],
        "input-capture",
        "5 of 8 photos are missing, photo0.png, photo1.png, photo2.png and 2 more",
    ),
    "a corrupt JPEG": (lambda folder: as_jpeg(folder, 600), "input-image", "photo1.jpg is "),
    "a JPEG of nothing": (lambda folder: as_jpeg(folder, 0), "input-image", "photo1.jpg is not a readable picture"),
    "16 bits": (in_16_bits, "input-image", "photo1.png has more than 8 bits a channel"),
    "black photos": (lambda folder: blacken(folder, range(PHOTOS)), "input-capture", "8 of 8 photos are black"),
    "all but one black": (lambda folder: blacken(folder, range(7)), "input-capture", "7 of 8 photos are black"),
    "nothing to test with": (
        lambda folder: edit(folder, lambda e: [entry.update(split="train") for entry in e]),
        "input-capture",
        "no photo to test with",
    ),
    "nothing to learn from": (
        lambda folder: edit(folder, lambda e: [entry.update(split="test") for entry in e]),
        "input-capture",
        "no photo to learn from",
    ),
    "a name twice": (
        lambda folder: edit(folder, lambda e: e[4].update(name="photo0.png")),
        "input-capture",
        "listed twice: photo0.png",
    ),
    "no names": (
        lambda folder: edit(folder, lambda e: [entry.pop("name") for entry in e]),
        "input-capture",
        "a photo has no name",
    ),
    "points at NaN": (points_at_nan, "input-cameras", "point 1 is not at a finite place"),
    "cut points": (
        lambda folder: (folder / "points3d.ply").write_bytes((folder / "points3d.ply").read_bytes()[:-1]),
        "input-corrupt",
        "points3d.ply",
    ),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_capture_that_cannot_be_used_is_one_clear_line(kind: str, tmp_path: Path) -> None:
    spoil, refusal, said = BAD[kind]
    spoil(captures.own(tmp_path))
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InvalidInput) as caught:
        load_capture(tmp_path)
    assert caught.value.refusal == refusal
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(("options", "field"), [({"resolution": 15}, "resolution"), ({"hold_out": 1}, "hold_out")])
def test_options_that_mean_nothing_are_refused(tmp_path: Path, options: dict[str, int], field: str) -> None:
    refuses("input-options", lambda: load_capture(tmp_path, **options), field=field)


def test_points_lie_where_a_ring_of_cameras_looks() -> None:
    found = draw_points(cameras())
    assert len(found) > 1000
    seen = np.mean([in_view(found, camera) for camera in cameras()], axis=0)
    assert seen.min() >= 1 / 3
    spread = np.abs(found - found.mean(axis=0)).max()
    np.testing.assert_allclose(found.mean(axis=0), scene().positions.mean(axis=0), atol=0.3 * spread)
    np.testing.assert_array_equal(found, draw_points(cameras()))


def test_cameras_that_see_nothing_in_common_see_some_each() -> None:
    angles = np.arange(8) * np.pi / 4
    eyes = [np.array([np.cos(angle), 0, np.sin(angle)]) for angle in angles]
    outward = [look_at(eye, 2 * eye, np.array([0.0, 1, 0]), 60, 60, 30) for eye in eyes]
    assert len(draw_points(outward)) > 100


def test_cameras_that_look_the_same_way_see_them_too() -> None:
    """Parallel axes meet nowhere."""
    row = []
    for step in range(4):
        pose = np.eye(4)
        pose[0, 3] = step
        row.append(replace(cameras()[0], world_to_camera=pose))
    found = draw_points(row)
    assert len(found) > 1000
    assert np.isfinite(found).all()
    assert in_view(found, row[0]).any()

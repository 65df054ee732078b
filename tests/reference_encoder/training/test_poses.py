"""Photos without poses, and lenses that distort: what COLMAP makes of them is used, and nothing half made is left.

COLMAP itself is an extra of its own. A stand-in does its part; the tests of what it computes are skipped without it.
"""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import struct
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from reference_encoder.training import poses
from reference_encoder.training.capture import load_capture, pixels
from reference_encoder.training.photo_files import wrong_capture
from scarfmt.arrays import F64, U8
from scarfmt.errors import InputWarning, InvalidInput
from scarfmt.formats import load
from scarfmt.render.camera import Camera, orbit_cameras
from scarfmt.render.capture import load_cameras
from scarfmt.render.images import to_bytes
from scarfmt.render.metrics import psnr
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import GaussianScene
from tests.conftest import REPOSITORY
from tests.reference_encoder.training import captures
from tests.reference_encoder.training.captures import HEIGHT, PHOTOS, WIDTH
from tests.render.capture import files
from tests.samples.codec_samples import refuses

needs_colmap = pytest.mark.skipif(importlib.util.find_spec("pycolmap") is None, reason="pycolmap is not installed")
RADIAL = 0.25


class Colmap:
    """A stand-in: it finds the poses that :mod:`captures` has, of all photos but some, and counts what it is asked."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.blind: set[int] = set()
        self.fails = False

    def __call__(self, action: str, folder: Path, path: Path, report: Callable[[str, float], None]) -> None:
        self.asked.append(action)
        report(action, 0.5)
        if self.fails:
            raise wrong_capture(path, "COLMAP failed: it did")
        staged = sorted((folder / "input").rglob("*.*"), key=lambda file: file.stem)
        found = [index for index in range(len(staged)) if index not in self.blind]
        shutil.copytree(folder / "input", folder / "images")
        names = [staged[index].relative_to(folder / "input").as_posix() for index in found]
        views = [replace(captures.cameras()[index], name=name) for index, name in zip(found, names, strict=True)]
        files.colmap_binary(views, folder / "sparse")
        (folder / "sparse" / "points3D.bin").write_bytes(files.colmap_points_binary(*captures.points()))
        (folder / "junk").mkdir()


def pretend(monkeypatch: pytest.MonkeyPatch, found: bool | None) -> None:
    """That pycolmap is installed, or not."""
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: found if name == "pycolmap" else find(name))


@pytest.fixture
def colmap(monkeypatch: pytest.MonkeyPatch) -> Colmap:
    stand_in = Colmap()
    monkeypatch.setattr(poses, "_run", stand_in)
    pretend(monkeypatch, True)
    return stand_in


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    captures.write_photos(captures.cameras(), tmp_path / "photos")
    return tmp_path / "photos"


def test_photos_alone_get_poses_and_points(colmap: Colmap, photos: Path, tmp_path: Path) -> None:
    """Under their own names, and once: what was made is read again."""
    told: list[str] = []
    first = load_capture(photos, workspace=tmp_path / "run", report=lambda stage, _part: told.append(stage))
    assert told == ["read the photos", "poses"]
    for photo, camera in zip(first.photos, captures.cameras(), strict=True):
        assert photo.camera.name == camera.name
        np.testing.assert_allclose(photo.camera.world_to_camera, camera.world_to_camera, atol=1e-9)
        np.testing.assert_array_equal(pixels(photo), captures.photo(camera))
    np.testing.assert_array_equal(first.points, captures.points()[0])
    for path in photos.iterdir():  # as copying them to another machine does
        os.utime(path, (1, 1))
    assert load_capture(photos, workspace=tmp_path / "run").digest == first.digest
    assert colmap.asked == ["poses"]
    made = tmp_path / "run" / poses.UNDISTORTED
    assert sorted(path.name for path in made.iterdir()) == ["cameras.json", "images", "source.txt", "sparse"]
    names = {camera.name for camera in captures.cameras()}  # by which `compare --photos` finds them
    assert {camera.name for camera in load_cameras(made)} == names
    assert {path.name for path in (made / "images").iterdir()} == names
    Image.new("RGB", (WIDTH, HEIGHT), (9, 90, 9)).save(photos / "photo0.png")
    load_capture(photos, workspace=tmp_path / "run")
    assert colmap.asked == ["poses", "poses"]


def test_photos_whose_pose_is_not_found_are_left_out_with_a_warning(
    colmap: Colmap, photos: Path, tmp_path: Path
) -> None:
    """Photos are left out if most have poses. Else the capture is refused, and nothing is left behind."""
    colmap.blind = {2, 5}
    with pytest.warns(InputWarning, match=r"left out photo2\.png, photo5\.png: no pose was found"):
        capture = load_capture(photos, workspace=tmp_path / "run")
    assert len(capture.photos) == PHOTOS - 2
    shutil.rmtree(tmp_path / "run")
    colmap.blind = set(range(5))
    with pytest.raises(InvalidInput, match="poses were found for 3 of 8 photos only"):
        load_capture(photos, workspace=tmp_path / "run")
    assert [path.name for path in tmp_path.iterdir()] == ["photos"]


def test_a_failure_leaves_nothing_half_made(colmap: Colmap, photos: Path, tmp_path: Path) -> None:
    """A failure leaves nothing, and what a kill left is removed the next time."""
    colmap.fails = True
    refuses("input-capture", lambda: load_capture(photos, workspace=tmp_path / "run"), "COLMAP failed")
    assert [path.name for path in tmp_path.iterdir()] == ["photos"]
    (tmp_path / "run" / ".undistorted.0.part" / "input").mkdir(parents=True)
    colmap.fails = False
    load_capture(photos, workspace=tmp_path / "run")
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["undistorted"]


def test_bad_photos_are_told_before_poses_are_looked_for(colmap: Colmap, photos: Path, tmp_path: Path) -> None:
    (photos / "photo3.png").write_bytes((photos / "photo3.png").read_bytes()[:200])
    refuses("input-image", lambda: load_capture(photos, workspace=tmp_path / "run"))
    for path in photos.iterdir():
        Image.new("RGB", (WIDTH, HEIGHT)).save(path)
    refuses("input-capture", lambda: load_capture(photos, workspace=tmp_path / "run"), "8 of 8 photos are black")
    for path in list(photos.iterdir())[1:]:
        path.unlink()
    refuses("input-capture", lambda: load_capture(photos, workspace=tmp_path / "run"), "1 photo; at least 2")
    assert colmap.asked == []


def test_a_workspace_is_needed_for_photos_made_anew(colmap: Colmap, photos: Path) -> None:
    refuses("input-options", lambda: load_capture(photos), "give a workspace")
    assert colmap.asked == []


def test_without_colmap_the_line_says_what_to_install(photos: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, None)
    with pytest.raises(InvalidInput) as caught:
        load_capture(photos)
    assert caught.value.refusal == "input-dependency"
    assert "photos but no poses; to find these: pip install 'scarfmt[poses]'" in str(caught.value)


# Lenses that distort


def distorted_photo(camera: Camera) -> U8:
    """The picture of `camera` through a lens of COLMAP's SIMPLE_RADIAL model."""
    wide = camera.resize(2 * WIDTH, 2 * HEIGHT)
    wide = replace(wide, fx=2 * camera.fx, fy=2 * camera.fy, cx=2 * camera.cx, cy=2 * camera.cy)
    seen = to_bytes(render(captures.scene(), replace(wide, width=2 * WIDTH, height=2 * HEIGHT)))
    row, column = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    bent = np.stack([(column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy])
    straight = bent
    for _ in range(50):
        straight = bent / (1 + RADIAL * (straight**2).sum(axis=0))
    x = np.clip(2 * (straight[0] * camera.fx + camera.cx), 0, 2 * WIDTH - 1).astype(int)
    y = np.clip(2 * (straight[1] * camera.fy + camera.cy), 0, 2 * HEIGHT - 1).astype(int)
    return seen[y, x]


def bent_colmap(folder: Path, radial: float = RADIAL) -> Path:
    captures.colmap(folder, "bin")
    lenses = [
        struct.pack("<iiQQ4d", index, 2, camera.width, camera.height, camera.fx, camera.cx, camera.cy, radial)
        for index, camera in enumerate(captures.cameras())
    ]
    (folder / "sparse" / "0" / "cameras.bin").write_bytes(struct.pack("<Q", len(lenses)) + b"".join(lenses))
    return folder


def lens_file(folder: Path, change: dict[str, Any]) -> Path:
    captures.nerfstudio(folder)
    document = json.loads((folder / "transforms.json").read_text())
    (folder / "transforms.json").write_text(json.dumps(document | change))
    return folder


IN_FILE = {"k1": RADIAL, "k2": 0, "p1": 0, "p2": 0, "test_filenames": ["images/photo4.png"]}
BENT = {"COLMAP": bent_colmap, "Nerfstudio": lambda folder: lens_file(folder, IN_FILE)}


@needs_colmap
@pytest.mark.parametrize("kind", BENT)
def test_what_a_lens_bent_is_straight_again(kind: str, tmp_path: Path) -> None:
    """Pictures drawn by the new cameras are like the new photos, and were not before; names and splits stay."""
    BENT[kind](tmp_path / "capture")
    for camera in captures.cameras():
        Image.fromarray(distorted_photo(camera)).save(tmp_path / "capture" / "images" / camera.name)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        capture = load_capture(tmp_path / "capture", workspace=tmp_path / "run")
    held_out = "photo4.png" if kind == "Nerfstudio" else "photo0.png"
    assert [Path(photo.camera.name).name for photo in capture.test] == [held_out]
    np.testing.assert_array_equal(capture.points, captures.points()[0])
    for photo, camera in zip(capture.photos, captures.cameras(), strict=True):
        assert Path(photo.camera.name).name == camera.name
        straight = psnr(render(captures.scene(), photo.camera), pixels(photo).astype(np.float64) / 255)
        bent = psnr(captures.photo(camera).astype(np.float64) / 255, distorted_photo(camera).astype(np.float64) / 255)
        assert straight > bent + 3


@needs_colmap
def test_photos_of_a_lens_that_hardly_distorts_are_taken_as_they_are(tmp_path: Path) -> None:
    """Made anew they are blurred, which costs more than a quarter of a pixel does; with more they are made anew."""
    camera = captures.cameras()[0]
    corner = np.hypot(camera.cx, camera.cy)
    quarter = 0.25 / corner / (camera.cx / camera.fx) ** 2
    taken = {}
    for radial in (0.3 * quarter, 3 * quarter):
        capture = load_capture(bent_colmap(tmp_path / f"{radial}", radial), workspace=tmp_path / f"run{radial}")
        taken[radial] = all(
            photo.camera.width == WIDTH and np.array_equal(pixels(photo), captures.photo(each))
            for photo, each in zip(capture.photos, captures.cameras(), strict=True)
        )
        for photo, each in zip(capture.photos, captures.cameras(), strict=True):
            np.testing.assert_allclose(photo.camera.world_to_camera, each.world_to_camera, atol=1e-9)
    assert list(taken.values()) == [True, False]


@pytest.mark.parametrize(
    ("change", "model", "expected"),
    [
        ({"k1": 0.1, "p2": 0.2}, "OPENCV", (0.1, 0, 0, 0.2)),
        ({"k1": 0.1, "k2": 0.2, "k3": 0.3, "p1": 0.4}, "FULL_OPENCV", (0.1, 0.2, 0.4, 0, 0.3, 0, 0, 0)),
        ({"camera_model": "OPENCV_FISHEYE", "k1": 1, "k4": 4}, "OPENCV_FISHEYE", (1, 0, 0, 4)),
        ({"is_fisheye": True, "k2": 2}, "OPENCV_FISHEYE", (0, 2, 0, 0)),
    ],
)
def test_a_frame_files_lens_is_one_of_colmaps(
    colmap: Colmap, tmp_path: Path, change: dict[str, Any], model: str, expected: tuple[float, ...]
) -> None:
    """COLMAP is given model, parameters in its order, and poses; photos keep their split, and are made once a lens."""
    change = change | {"test_filenames": ["images/photo4.png"]}
    given: dict[str, list[list[str]]] = {}

    def look(action: str, folder: Path, path: Path, report: Callable[[str, float], None]) -> None:
        for name in ("cameras", "images"):
            text = (folder / "model" / f"{name}.txt").read_text()
            given[name] = [line.split() for line in text.splitlines() if line]
        colmap(action, folder, path, report)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(poses, "_run", look)
        capture = load_capture(lens_file(tmp_path / "capture", change), workspace=tmp_path / "run")
    assert [photo.camera.name for photo in capture.test] == ["images/photo4.png"]
    assert not (tmp_path / "run" / poses.UNDISTORTED / "junk").exists()
    load_capture(lens_file(tmp_path / "other", change), workspace=tmp_path / "run")
    load_capture(lens_file(tmp_path / "more", change | {"k1": 0.3}), workspace=tmp_path / "run")
    assert colmap.asked == ["undistort"] * 2
    camera = captures.cameras()[0]
    assert given["cameras"][0][1:4] == [model, str(WIDTH), str(HEIGHT)]
    numbers: F64 = np.array(given["cameras"][0][4:], np.float64)
    np.testing.assert_allclose(numbers, (camera.fx, camera.fy, camera.cx, camera.cy, *expected))
    np.testing.assert_allclose(np.array(given["images"][0][5:8], np.float64), camera.world_to_camera[:3, 3], atol=1e-9)


@pytest.mark.parametrize("change", [{"k4": 0.1}, {"camera_model": "EQUIRECTANGULAR"}])
def test_lenses_that_colmap_lacks_are_refused(tmp_path: Path, change: dict[str, Any]) -> None:
    with pytest.raises(InvalidInput, match="cannot be drawn"):
        load_capture(lens_file(tmp_path, change), workspace=tmp_path / "run")


# COLMAP itself


@needs_colmap
def test_poses_are_found(tmp_path: Path) -> None:
    """The poses of twelve pictures of the example scene are found, up to the similarity that photos leave open."""
    scene = load(REPOSITORY / "examples" / "plush-toys.ply")
    assert isinstance(scene, GaussianScene)
    views = orbit_cameras(scene, 12, 480, 360, up="-y:125:50", radius_factor=0.8)
    (tmp_path / "photos").mkdir()
    for index, camera in enumerate(views):
        Image.fromarray(to_bytes(render(scene, camera))).save(tmp_path / "photos" / f"{index:02}.png")
    capture = load_capture(tmp_path / "photos", workspace=tmp_path / "run")
    assert len(capture.photos) == 12
    assert len(capture.points) > 100
    found = np.array([photo.camera.centre for photo in capture.photos])
    true = np.array([camera.centre for camera in views])
    assert np.abs(true - aligned(found, true)).max() < 0.02 * np.ptp(true, axis=0).max()
    # The pictures are a pinhole's, and stay what they are.
    for photo, camera in zip(capture.photos, views, strict=True):
        np.testing.assert_array_equal(pixels(photo), to_bytes(render(scene, camera)))
        assert abs(photo.camera.fx / camera.fx - 1) < 0.02


def aligned(found: F64, true: F64) -> F64:
    """`found` under the similarity that brings it closest to `true` (Umeyama 1991)."""
    middle, target = found.mean(axis=0), true.mean(axis=0)
    left, size, right = np.linalg.svd((true - target).T @ (found - middle))
    signs = np.array([1, 1, np.sign(np.linalg.det(left @ right))])
    scale = (size * signs).sum() / ((found - middle) ** 2).sum()
    turned: F64 = target + scale * (found - middle) @ ((left * signs) @ right).T
    return turned


@needs_colmap
def test_photos_of_nothing_in_common_are_one_line(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    (tmp_path / "photos").mkdir()
    for index in range(4):
        Image.fromarray(random.integers(0, 256, (60, 80, 3), np.uint8)).save(tmp_path / "photos" / f"{index}.jpg")
    refuses("input-capture", lambda: load_capture(tmp_path / "photos", workspace=tmp_path / "run"), r"\A[^\n]*\Z")
    assert [path.name for path in tmp_path.iterdir()] == ["photos"]

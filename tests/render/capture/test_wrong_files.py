"""Files that are not what they should be get one sentence, and never another exception."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from scarfmt.errors import InvalidInput
from scarfmt.render import capture
from scarfmt.render.camera import Camera
from scarfmt.render.capture import load_cameras
from scarfmt.render.capture.colmap import MODELS
from tests.samples.codec_samples import refuses

from . import files

CAMERA = files.camera(3)
HOSTILE = settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
NUMBERS = st.floats() | st.integers(-(10**400), 10**400) | st.integers(-2, 70000)
JSON = st.recursive(
    st.none() | st.booleans() | NUMBERS | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=20,
)
pytestmark = pytest.mark.filterwarnings("ignore::scarfmt.errors.InputWarning")


def refused(path: Path) -> str:
    with pytest.raises(InvalidInput) as caught:
        load_cameras(path)
    assert caught.value.refusal == "input-cameras"
    assert str(path) in str(caught.value) or str(path.parent) in str(caught.value)
    return str(caught.value)


def read_or_refused(path: Path) -> None:
    """Whatever the file holds: cameras that can be drawn from, or the refusal."""
    try:
        cameras = load_cameras(path)
    except InvalidInput as refusal:
        said = refusal.refusal
    else:
        said = "input-cameras"
        _assert_usable(cameras)
    assert said == "input-cameras"


def _assert_usable(cameras: list[Camera]) -> None:
    for camera in cameras:
        assert 0 < camera.width <= 65536
        assert 0 < camera.height <= 65536
        assert min(camera.fx, camera.fy) > 0
        assert np.isfinite(camera.world_to_camera).all()
        assert np.isfinite([camera.fx, camera.fy, camera.cx, camera.cy]).all()


def documents() -> dict[str, Any]:
    return {
        "own": files.own([CAMERA]),
        "inria": {"list": files.inria([CAMERA])},
        "transforms": files.transforms([CAMERA]) | {"applied_scale": 1, "k1": 0.1},
    }


def values_of(document: Any) -> list[tuple[Any, Any]]:
    """(container, key) of every value in a JSON document, outermost first."""
    items: Iterable[tuple[Any, Any]] = ()
    if isinstance(document, dict | list):
        items = list(document.items() if isinstance(document, dict) else enumerate(document))
    return [(document, key) for key, _ in items] + [found for _, value in items for found in values_of(value)]


@HOSTILE
@given(st.sampled_from(["own", "inria", "transforms"]), st.data())
def test_any_value_anywhere_is_read_or_refused(tmp_path: Path, kind: str, data: st.DataObject) -> None:
    document = documents()[kind]
    places = [place for place in values_of(document) if place[1] != "list"]
    container, key = data.draw(st.sampled_from(places))
    container[key] = data.draw(JSON)
    read_or_refused(files.in_json(document.get("list", document), tmp_path / "a.json"))


@HOSTILE
@given(JSON, st.sampled_from(["", "images", "frames"]))
def test_any_json_is_read_or_refused(tmp_path: Path, value: Any, key: str) -> None:
    read_or_refused(files.in_json({key: value} if key else value, tmp_path / "a.json"))


@HOSTILE
@given(st.binary(max_size=60))
def test_any_bytes_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.json").write_bytes(content)
    refused(tmp_path / "a.json")


@HOSTILE
@given(st.sampled_from(["bin", "txt"]), st.sampled_from(["cameras", "images"]), st.data())
def test_damaged_sparse_models_are_read_or_refused(tmp_path: Path, form: str, name: str, data: st.DataObject) -> None:
    (files.colmap_binary if form == "bin" else files.colmap_text)([CAMERA, files.camera(4)], tmp_path)
    for other in tmp_path.glob("*.txt" if form == "bin" else "*.bin"):
        other.unlink()
    path = tmp_path / f"{name}.{form}"
    content = bytearray(path.read_bytes()[:600])
    for _ in range(data.draw(st.integers(0, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    read_or_refused(tmp_path)


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin"])
def test_a_sparse_model_cut_anywhere_is_refused(tmp_path: Path, name: str) -> None:
    files.colmap_binary([CAMERA], tmp_path)
    whole = (tmp_path / name).read_bytes()
    for length in range(len(whole)):
        (tmp_path / name).write_bytes(whole[:length])
        assert "ends too early" in refused(tmp_path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"fx": 0}, r"fx is 0 and has to be above 0; export the cameras again \(images\[0\].fx\)"),
        ({"fy": float("nan")}, "fy is nan, not a finite number"),
        ({"fy": True}, "fy is True, not a finite number"),
        ({"W": 0}, "W is 0"),
        ({"H": 1e6}, "H is 1e"),
        ({"W": 8.5}, "whole pixels"),
        ({"cx": None}, "cx is missing"),
        ({"split": "valid"}, "split is 'valid'"),
        ({"world_to_camera": (2 * np.eye(4)).tolist()}, "last row"),
        ({"world_to_camera": np.diag([1.01, 1, 1, 1]).tolist()}, "scales or shears"),
        ({"world_to_camera": np.diag([1.0, 1, -1, 1]).tolist()}, "mirrors"),
        ({"world_to_camera": np.zeros((4, 4)).tolist()}, "last row"),
        ({"world_to_camera": [[1, 2], [3, 4]]}, "4 x 4 finite numbers"),
        ({"world_to_camera": np.full((4, 4), np.nan).tolist()}, "4 x 4 finite numbers"),
    ],
)
def test_the_sentence_says_what_and_where(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    document = files.own([CAMERA])
    document["images"][0] |= change
    refuses("input-cameras", lambda: load_cameras(files.in_json(document, tmp_path / "a.json")), said)


FRAME: dict[str, Any] = {"transform_matrix": np.eye(4).tolist(), "w": 8, "h": 8}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"camera_model": "OPENCV_FISHEYE"}, "OPENCV_FISHEYE cannot be drawn; undistort"),
        ({"is_fisheye": True}, "FISHEYE cannot be drawn"),
        ({"camera_model": "EQUIRECTANGULAR"}, "cut the panoramas"),
        ({"test_filenames": [1]}, "test_filenames has to be a list"),
        ({"frames": [FRAME]}, "no focal length"),
        ({"frames": [FRAME | {"camera_angle_x": 3.2}]}, "radians"),
        ({"frames": [FRAME | {"camera_angle_x": -1}]}, "above 0"),
    ],
)
def test_transforms_that_cannot_be_drawn_are_refused(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    path = files.in_json(files.transforms([CAMERA]) | change, tmp_path / "a.json")
    refuses("input-cameras", lambda: load_cameras(path), said)


def test_fisheye_lenses_of_colmap_are_refused_with_what_to_do(tmp_path: Path) -> None:
    files.colmap_binary([CAMERA], tmp_path)
    (tmp_path / "cameras.bin").write_bytes(struct.pack("<QiiQQ8d", 1, 0, 5, 8, 6, *(1.0,) * 8))
    assert "image_undistorter" in refused(tmp_path)
    (tmp_path / "cameras.bin").write_bytes(struct.pack("<QiiQQ8d", 1, 0, len(MODELS), 8, 6, *(1.0,) * 8))
    assert f"model {len(MODELS)} is not known" in refused(tmp_path)


def test_a_million_declared_cameras_cost_nothing(tmp_path: Path) -> None:
    files.colmap_binary([CAMERA], tmp_path)
    (tmp_path / "images.bin").write_bytes(struct.pack("<Q", 1 << 60))
    assert "declares" in refused(tmp_path)


@pytest.mark.parametrize(("limit", "said"), [("MAX_CAMERAS", "lists 1 cameras"), ("MAX_LISTING_BYTES", "far smaller")])
@pytest.mark.parametrize("make", [files.own, files.inria, files.transforms])
def test_lists_beyond_a_limit_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, said: str, make: Any
) -> None:
    monkeypatch.setattr(capture, limit, 0)
    refuses("input-cameras", lambda: load_cameras(files.in_json(make([CAMERA]), tmp_path / "a.json")), said)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('<?xml version="1.0"?>\n<document version="2.0.0">', "Metashape"),
        ("#name,x,y,alt\n", "RealityScan"),
        ("NVM_V3 \n", "VisualSFM"),
        ("SQLite format 3\0", "no poses"),
        ('[{"cameras": {}, "shots": {}, "points": {}}]', "OpenSfM"),
        ('{"sfm_data_version": "0.3", "views": [], "intrinsics": []}', "openMVG"),
        ('{"views": [], "intrinsics": [], "poses": []}', "Meshroom"),
        ('{"t_00": 1, "t_23": 0, "fx": 500}', "ns-process-data polycam"),
        ('{"poses": [], "K": []}', "ns-process-data record3d"),
        ('{"camera_path": []}', "for a video"),
    ],
)
def test_files_of_other_programs_are_named(tmp_path: Path, content: str, said: str) -> None:
    path = tmp_path / "cameras"
    path.write_text(content)
    refuses("input-cameras", lambda: load_cameras(path), said)


def test_what_is_no_camera_file_is_told_what_is(tmp_path: Path) -> None:
    for content in ("", "{}", "[1]", '{"images": 3}', '{"frames": {}}', "[" * 100_000, '"x"', "ply\nformat"):
        path = tmp_path / "a.json"
        path.write_text(content)
        refused(path)
    for content in ('{"images": []}', "[]"):
        path.write_text(content)
        assert "lists no cameras" in refused(path)
    (tmp_path / "empty").mkdir()
    assert "no cameras in this folder" in refused(tmp_path / "empty")
    (tmp_path / "cameras.bin").write_bytes(b"")
    assert "needed both" in refused(tmp_path / "cameras.bin")

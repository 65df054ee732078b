"""Camera files of every program give the same cameras."""

from __future__ import annotations

import struct
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from scarfmt.errors import InputWarning, InvalidInput
from scarfmt.render.camera import Camera
from scarfmt.render.capture import held_out, load_cameras, load_distorted, load_points
from scarfmt.render.images import write_png
from tests.formats.scene_files import ply
from tests.samples.codec_samples import refuses

from . import files

SEVERAL = [files.camera(seed, "test" if seed == 2 else "") for seed in range(4)]


def written(kind: str, cameras: list[Camera], folder: Path) -> Path:
    """The path to give to :func:`load_cameras` for cameras in a format."""
    if kind == "colmap binary":
        return files.colmap_binary(cameras, folder)
    if kind == "colmap text":
        return files.colmap_text(cameras, folder)
    content = {"own": files.own, "inria": files.inria, "transforms": files.transforms}[kind](cameras)
    return files.in_json(content, folder / "any name")


def assert_alike(found: list[Camera], expected: list[Camera]) -> None:
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        assert (one.width, one.height, one.name) == (other.width, other.height, other.name)
        np.testing.assert_allclose([one.fx, one.fy, one.cx, one.cy], [other.fx, other.fy, other.cx, other.cy])
        np.testing.assert_allclose(one.world_to_camera, other.world_to_camera, atol=1e-9)


KINDS = ("own", "inria", "transforms", "colmap binary", "colmap text")


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.integers(0, 9999), min_size=1, max_size=5, unique=True))
def test_what_was_written_is_read(kind: str, tmp_path: Path, seeds: list[int]) -> None:
    cameras = [files.camera(seed) for seed in sorted(seeds)]
    assert_alike(load_cameras(written(kind, cameras, tmp_path)), cameras)


@pytest.mark.parametrize("kind", ["own", "transforms"])
def test_the_split_is_kept_where_the_file_has_one(kind: str, tmp_path: Path) -> None:
    found = load_cameras(written(kind, SEVERAL, tmp_path))
    assert [camera.split for camera in found] == ["", "", "test", ""]
    assert held_out(found) == [found[2]]
    assert held_out(found[:2]) == found[:2]


@pytest.mark.parametrize("inner", ["", "sparse", "sparse/0", "0", "colmap/sparse/0"])
@pytest.mark.parametrize("kind", ["colmap binary", "colmap text"])
def test_a_sparse_model_is_found_in_its_folders(kind: str, inner: str, tmp_path: Path) -> None:
    model = written(kind, SEVERAL[::-1], tmp_path / inner)
    assert_alike(load_cameras(tmp_path), SEVERAL)
    assert_alike(load_cameras(next(model.glob("images.*"))), SEVERAL)


def test_models_of_parts_that_are_not_read_are_named(tmp_path: Path) -> None:
    """COLMAP numbers the models of photos that it could not join; the first need not be the largest."""
    files.colmap_text(SEVERAL[:1], tmp_path / "sparse" / "0")
    files.colmap_text(SEVERAL, tmp_path / "sparse" / "1")
    with pytest.warns(InputWarning, match=r"one of 2 models .* another: 1"):
        assert_alike(load_cameras(tmp_path), SEVERAL[:1])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_alike(load_cameras(tmp_path / "sparse" / "0"), SEVERAL[:1])


@pytest.mark.parametrize("inner", ["sparse/1", "dense/sparse", "a/b/c"])
def test_a_sparse_model_in_another_folder_is_named(inner: str, tmp_path: Path) -> None:
    files.colmap_binary(SEVERAL, tmp_path / inner)
    refuses("input-cameras", lambda: load_cameras(tmp_path), f"give .*{inner}")


def test_text_keeps_names_with_spaces_and_an_image_without_a_line_after_it(tmp_path: Path) -> None:
    cameras = [replace(camera, name=f"photo {number}.jpg") for number, camera in enumerate(SEVERAL)]
    listing = files.colmap_text(cameras, tmp_path) / "images.txt"
    listing.write_text(listing.read_text().rstrip("\n -1.25") + "\n")
    assert_alike(load_cameras(tmp_path), cameras)


@pytest.mark.parametrize("length", [0.5, 1.02, 3.0])
def test_quaternions_of_any_length_are_rotations(length: float, tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text("1 Pinhole 640 480 500 500 320 240\n")
    half = length / 2**0.5
    (tmp_path / "images.txt").write_text(f"1 {half} 0 {half} 0 1 2 3 1 a.jpg\n\n")
    (camera,) = load_cameras(tmp_path)
    np.testing.assert_allclose(camera.world_to_camera[:3, :3], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-12)


def test_text_files_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    model = files.colmap_text(SEVERAL, tmp_path)
    for name in ("cameras.txt", "images.txt"):
        (model / name).write_text("\ufeff" + (model / name).read_text().split("\n", 1)[1], encoding="utf-8")
    assert_alike(load_cameras(model), SEVERAL)


def test_of_a_folder_the_list_that_tells_most_is_taken(tmp_path: Path) -> None:
    files.in_json(files.transforms(SEVERAL[:1]), tmp_path / "transforms.json")
    assert len(load_cameras(tmp_path)) == 1
    files.colmap_binary(SEVERAL[:2], files.colmap_text(SEVERAL[:1], tmp_path / "sparse" / "0"))
    assert len(load_cameras(tmp_path)) == 2
    files.in_json(files.own(SEVERAL[:3]), tmp_path / "cameras.json")
    assert len(load_cameras(tmp_path)) == 3


def test_opengl_axes_look_along_minus_z(tmp_path: Path) -> None:
    frame = {"file_path": "a", "transform_matrix": np.eye(4).tolist()}
    (camera,) = load_cameras(files.in_json({"fl_x": 9, "w": 8, "h": 6, "frames": [frame]}, tmp_path / "t.json"))
    np.testing.assert_array_equal(camera.world_to_camera[:3, :3] @ (0, 0, -1), (0, 0, 1))  # forward
    np.testing.assert_array_equal(camera.world_to_camera[:3, :3] @ (0, 1, 0), (0, -1, 0))  # up
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (9, 9, 4, 3)


def test_blender_files_name_an_angle_and_the_picture_its_size(tmp_path: Path) -> None:
    frame = {"file_path": "./train/r_0", "transform_matrix": np.eye(4).tolist()}
    path = files.in_json({"camera_angle_x": np.pi / 2, "frames": [frame]}, tmp_path / "transforms_train.json")
    refuses("input-cameras", lambda: load_cameras(path), r"neither w and h are there nor the photo './train/r_0'")
    (tmp_path / "train").mkdir()
    write_png(tmp_path / "train" / "r_0.png", np.zeros((30, 40, 3), np.float32))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (camera,) = load_cameras(path)
    assert (camera.width, camera.height) == (40, 30)
    assert (camera.fx, camera.fy) == (pytest.approx(20), pytest.approx(20))


@pytest.mark.parametrize(
    ("said", "focal"),
    [
        ({"camera_angle_y": 2 * np.arctan(0.5)}, (6, 6)),
        ({"camera_angle_y": 2 * np.arctan(0.5), "fl_x": 9}, (9, 6)),
        ({"fl_x": 9}, (9, 9)),
        ({"fl_y": 9}, (9, 9)),
        ({"fl_x": 9, "fl_y": 8, "camera_angle_x": 0.1, "camera_angle_y": 0.1}, (9, 8)),
    ],
)
@pytest.mark.parametrize("in_frame", [True, False])
def test_one_focal_length_or_angle_is_enough(
    said: dict[str, float], focal: tuple[float, float], in_frame: bool, tmp_path: Path
) -> None:
    above = {"w": 8, "h": 6, "aabb_scale": 16, "offset": [0.5, 0.5, 0.5], "scale": 0.33}
    frame = {"file_path": "a", "transform_matrix": np.eye(4).tolist(), "sharpness": 30.0}
    above |= dict.fromkeys(said, 0.2) if in_frame else said
    content = above | {"frames": [frame | (said if in_frame else {})]}
    (camera,) = load_cameras(files.in_json(content, tmp_path / "transforms.json"))
    assert (camera.fx, camera.fy) == pytest.approx(focal)


@pytest.mark.parametrize("ending", ["jpg", "png", "JPG"])
def test_each_photo_says_its_own_size(ending: str, tmp_path: Path) -> None:
    frames = [{"file_path": f"{name}.{ending}", "transform_matrix": np.eye(4).tolist()} for name in "ab"]
    path = files.in_json({"camera_angle_x": 0.8, "frames": frames}, tmp_path / "transforms.json")
    for name, size in (("a", (64, 48)), ("b", (30, 40))):
        Image.new("RGB", size).save(tmp_path / f"{name}.{ending}")
    sizes = [(camera.width, camera.height, camera.fx) for camera in load_cameras(path)]
    assert sizes == [(64, 48, pytest.approx(32 / np.tan(0.4))), (30, 40, pytest.approx(15 / np.tan(0.4)))]
    (tmp_path / f"b.{ending}").write_bytes(b"no picture")
    refuses("input-cameras", lambda: load_cameras(path), "no readable picture")


@pytest.mark.parametrize("name", ["photos/a.png", "./photos/a.png", ".\\photos\\a.png", "./photos/a"])
def test_a_photo_is_found_however_its_name_is_written(name: str, tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    write_png(tmp_path / "photos" / "a.png", np.zeros((6, 8, 3), np.float32))
    frame = {"file_path": name, "transform_matrix": np.eye(4).tolist()}
    plain = "photos/a.png" if name.endswith(".png") else "photos/a"
    content = {"camera_angle_x": 0.8, "frames": [frame], "val_filenames": [plain]}
    (camera,) = load_cameras(files.in_json(content, tmp_path / "transforms.json"))
    assert (camera.width, camera.height, camera.split) == (8, 6, "test")


def test_images_with_one_line_each_are_all_read(tmp_path: Path) -> None:
    """COLMAP writes a line of points after each; tools without points leave out the empty line."""
    cameras = [replace(camera, name=str(number)) for number, camera in enumerate(SEVERAL)]
    model = files.colmap_text(cameras, tmp_path)
    lines = (model / "images.txt").read_text().split("\n")
    (model / "images.txt").write_text("\n".join(line for line in lines if line and line[:8] != "1.5 2.5 ") + "\n")
    assert_alike(load_cameras(model), cameras)


def test_a_list_shorter_than_its_header_says_is_told(tmp_path: Path) -> None:
    model = files.colmap_text(SEVERAL, tmp_path)
    path = model / "images.txt"
    path.write_text(f"# Number of images: {len(SEVERAL) + 1}, mean observations per image: 3\n" + path.read_text())
    with pytest.warns(InputWarning, match=f"holds {len(SEVERAL)} images, but its header says {len(SEVERAL) + 1}"):
        assert len(load_cameras(model)) == len(SEVERAL)


@pytest.mark.parametrize("model", ["OPENCV_FISHEYE 8 6 1 1 4 3 0 0 0 0", "A_MODEL_OF_TOMORROW 8 6 1 2 3"])
def test_a_lens_that_no_image_uses_is_no_fault(model: str, tmp_path: Path) -> None:
    folder = files.colmap_text(SEVERAL, tmp_path)
    with (folder / "cameras.txt").open("a") as stream:
        stream.write(f"99 {model}\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_alike(load_cameras(folder), SEVERAL)


def test_blenders_files_for_each_split_are_read_together(tmp_path: Path) -> None:
    """One alone marks nothing."""
    files.in_json(files.transforms(SEVERAL[:3]), tmp_path / "transforms_train.json")
    assert {camera.split for camera in load_cameras(tmp_path)} <= {"", "test"}
    files.in_json(files.transforms(SEVERAL[3:]), tmp_path / "transforms_test.json")
    files.in_json(files.transforms(SEVERAL[:1]), tmp_path / "transforms_val.json")
    assert [camera.split for camera in load_cameras(tmp_path)] == ["train"] * 3 + ["test"]
    assert held_out(load_cameras(tmp_path))[0].name == SEVERAL[3].name


def test_what_is_held_out_to_validate_is_tested_where_nothing_else_is(tmp_path: Path) -> None:
    for index, name in enumerate(("train", "val")):
        files.in_json(files.transforms(SEVERAL[index : index + 1]), tmp_path / f"transforms_{name}.json")
    assert [camera.split for camera in load_cameras(tmp_path)] == ["train", "test"]


def test_null_is_as_absent_and_axes_of_others_are_refused(tmp_path: Path) -> None:
    frame = {"file_path": "a", "transform_matrix": np.eye(4).tolist(), "cx": None}
    content = {"w": 8, "h": 6, "fl_x": None, "fl_y": 9, "k1": None, "frames": [frame]}
    (camera,) = load_cameras(files.in_json(content, tmp_path / "transforms.json"))
    assert (camera.fx, camera.cx) == (9, 4)
    with pytest.raises(InvalidInput, match="Mitsuba"):
        load_cameras(files.in_json(content | {"from_mitsuba": True}, tmp_path / "transforms.json"))


def test_a_principal_point_of_inrias_list_counts(tmp_path: Path) -> None:
    content = files.inria(SEVERAL[:1])
    content[0] |= {"cx": 1.5, "cy": 2.5}
    (camera,) = load_cameras(files.in_json(content, tmp_path / "cameras.json"))
    assert (camera.cx, camera.cy) == (1.5, 2.5)


def test_a_last_row_may_be_rounded(tmp_path: Path) -> None:
    content = files.own(SEVERAL[:1])
    exact = load_cameras(files.in_json(content, tmp_path / "exact.json"))
    content["images"][0]["world_to_camera"][3] = [1e-7, 0, -1e-7, 0.9999999]
    assert_alike(load_cameras(files.in_json(content, tmp_path / "rounded.json")), exact)


def test_nerfstudios_own_frame_is_gone_to_where_its_file_is_there(tmp_path: Path) -> None:
    """The trainer's transform maps the world before `applied_transform`; positions are scaled after it."""
    original = files.camera(5)
    applied, dataparser = (np.linalg.inv(files.camera(seed).world_to_camera) for seed in (6, 7))
    frame = {"file_path": "a", "transform_matrix": (applied @ files.opengl_pose(original)).tolist()}
    document = {"fl_x": 9, "w": 8, "h": 6, "applied_transform": applied[:3].tolist(), "frames": [frame]}
    document |= {"applied_scale": 2.0, "ply_file_path": "eyes.ply"}
    eye = applied[:3, :3] @ original.centre + applied[:3, 3]
    (tmp_path / "eyes.ply").write_bytes(ply([("double", axis) for axis in "xyz"], eye[None]))
    path = files.in_json(document, tmp_path / "transforms.json")
    files.in_json({"transform": dataparser[:3].tolist(), "scale": 0.5}, tmp_path / "dataparser_transforms.json")
    (camera,) = load_cameras(path)
    expected = 0.25 * (dataparser[:3, :3] @ original.centre + dataparser[:3, 3])
    np.testing.assert_allclose(camera.centre, expected, atol=1e-9)
    np.testing.assert_allclose(load_points(path), [expected], atol=1e-9)
    turned = dataparser[:3, :3] @ original.world_to_camera[:3, :3].T
    np.testing.assert_allclose(camera.world_to_camera[:3, :3].T, turned, atol=1e-9)


@pytest.mark.parametrize(
    ("model", "parameters", "expected"),
    [
        (0, (50, 4, 3), (50, 50, 4, 3)),
        (2, (50, 4, 3, 0.1), (50, 50, 4, 3)),
        (3, (50, 4, 3, 0.1, 0.2), (50, 50, 4, 3)),
        (4, (50, 60, 4, 3, 0.1, 0, 0, 0), (50, 60, 4, 3)),
        (6, (50, 60, 4, 3, *(0.1,) * 8), (50, 60, 4, 3)),
    ],
)
def test_lenses_that_distort_are_taken_as_pinholes_with_a_warning(
    tmp_path: Path, model: int, parameters: tuple[float, ...], expected: tuple[float, ...]
) -> None:
    files.colmap_binary([files.camera(1)], tmp_path)
    lens = struct.pack(f"<QiiQQ{len(parameters)}d", 1, 0, model, 8, 6, *parameters)
    (tmp_path / "cameras.bin").write_bytes(lens)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        (camera,) = load_cameras(tmp_path)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == expected
    assert [str(one.message).endswith("lens distortion is ignored") for one in caught] == [True] * (model != 0)


def test_distortion_of_a_transforms_file_is_told(tmp_path: Path) -> None:
    path = files.in_json(files.transforms(SEVERAL) | {"k1": 0.01}, tmp_path / "t.json")
    with pytest.warns(InputWarning, match="distortion"):
        assert_alike(load_cameras(path), SEVERAL)


@pytest.mark.parametrize("above", [True, False])
def test_a_list_of_coefficients_distorts_as_each_by_its_name(tmp_path: Path, above: bool) -> None:
    """Nerfstudio reads `distortion_params` before k1 and the others, in a frame and above."""
    views = []
    for said in ({"k1": 0.1, "k2": 0.2, "p1": 0.3, "p2": 0.4}, {"distortion_params": [0.1, 0.2, 0, 0, 0.3, 0.4]}):
        document = files.transforms(SEVERAL)
        for holder in [document] if above else document["frames"]:
            holder |= said
        views.append(load_distorted(files.in_json(document, tmp_path / "t.json")))
    assert len(views[0]) == len(SEVERAL)
    assert [(view.model, view.parameters) for view in views[0]] == [(view.model, view.parameters) for view in views[1]]


@pytest.mark.parametrize("distortion", [0, 0.01])
def test_masks_are_told_of_once(tmp_path: Path, distortion: float) -> None:
    """What a mask hides, such as people who walk by, would be trained on without a word."""
    document = files.transforms(SEVERAL) | {"k1": distortion}
    document["frames"][1]["mask_path"] = "masks/1.png"
    path = files.in_json(document, tmp_path / "t.json")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        _ = load_distorted(path) or load_cameras(path)
    assert ["masks (mask_path) of 1 photo are not read" in str(one.message) for one in caught] == [True]


def test_reading_cameras_imports_nothing_heavy(tmp_path: Path) -> None:
    """A wrong file is refused before a renderer is compiled."""
    path = files.in_json(files.own(SEVERAL), tmp_path / "a.json")
    code = (
        f"from scarfmt.render.capture import load_cameras; load_cameras({str(path)!r}); import sys; print(*sys.modules)"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"numba", "torch", "scipy", "PIL", "rich"} & set(loaded)

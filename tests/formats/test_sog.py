"""PlayCanvas SOG."""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from scarfmt.container.registries import RenderModel
from scarfmt.errors import InvalidInput, Unsupported
from scarfmt.formats import load, sog
from scarfmt.formats.source import Source
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.rotation import matrix_from_quaternion
from tests.formats.scene_files import read_scene, sog_files, unit_quaternions, webp, zipped
from tests.samples.codec_samples import refuses


def read(files: dict[str, bytes]) -> GaussianScene:
    return read_scene(zipped(files))


def edited(change: Callable[[dict[str, Any]], object]) -> dict[str, bytes]:
    """The files of a SOG after a change of its metadata."""
    files = sog_files()
    meta = json.loads(files["meta.json"])
    change(meta)
    return files | {"meta.json": json.dumps(meta).encode()}


def with_meta(**changes: object) -> dict[str, bytes]:
    return edited(lambda meta: meta.update(changes))


@pytest.mark.parametrize("bands", [0, 1, 2, 3])
def test_version_2_fields(bands: int) -> None:
    scene = read(sog_files(6, bands=bands))
    row = np.arange(6)
    logarithmic = -1 + 2 * row / 65535
    np.testing.assert_allclose(scene.positions[:, 0], -(np.exp(-logarithmic) - 1), rtol=1e-9)
    np.testing.assert_allclose(scene.positions[:, 1], np.exp(2) - 1, rtol=1e-9)
    np.testing.assert_allclose(scene.positions[:, 2], np.exp(-1 + 4 * 0x8000 / 65535) - 1, rtol=1e-9)
    np.testing.assert_array_equal(scene.log_scales, np.float32([[i / 8 - 4, -2, 0] for i in row]))
    np.testing.assert_array_equal(scene.sh[:, 0], np.float32([[0, 1, i / 8 - 4] for i in row]))
    np.testing.assert_allclose(scene.rotations, unit_quaternions(6), atol=0.01)
    alpha = np.clip(255 - row, 0.5, 254.5) / 255
    np.testing.assert_allclose(scene.opacity_logits, np.log(alpha / (1 - alpha)), rtol=1e-5)
    assert scene.sh_degree == bands
    for coefficient in range(scene.sh.shape[1] - 1):
        np.testing.assert_array_equal(scene.sh[:, 1 + coefficient, 0], np.float32((63 - row) / 8 - 4))
        np.testing.assert_array_equal(scene.sh[:, 1 + coefficient, 1], np.float32(coefficient / 8 - 4))


def test_version_1_has_ranges_and_logits() -> None:
    scene = read(sog_files(6, version=1))
    row = np.arange(6)
    np.testing.assert_allclose(
        scene.log_scales, [[-9 + 9 * byte / 255 for byte in (i, 16, 32)] for i in row], rtol=1e-6
    )
    np.testing.assert_allclose(scene.opacity_logits, 5 - 10 * row / 255, rtol=1e-6)
    np.testing.assert_allclose(scene.sh[:, 1, 0], -1 + 2 * (63 - row) / 255, rtol=1e-6)


@pytest.mark.parametrize("change", [{"bands": 0}, {"bands": None}, {}])
def test_the_palette_says_the_degree_where_bands_do_not(change: dict[str, object]) -> None:
    def without_bands(meta: dict[str, Any]) -> None:
        del meta["shN"]["bands"]
        meta["shN"] |= change

    np.testing.assert_array_equal(read(edited(without_bands)).sh, read(sog_files()).sh)


@pytest.mark.parametrize("has_alpha", [True, False])
@pytest.mark.parametrize("name", ["means_u.webp", "quats.webp"])
def test_an_image_that_was_compressed_with_losses_is_refused(name: str, has_alpha: bool) -> None:
    """Servers and page builders rewrite pictures so: its pixels are near, but numbers are not."""
    files = sog_files()
    out = io.BytesIO()
    with Image.open(io.BytesIO(files[name])) as image:
        image.convert("RGBA" if has_alpha else "RGB").save(out, "WEBP", quality=90)
    refuses("input-corrupt", lambda: read(files | {name: out.getvalue()}), "with losses", field=name)


def test_a_member_of_other_formats_does_not_mislead() -> None:
    """splat-transform writes `asset`, as glTF has it."""
    assert len(read(with_meta(asset={"generator": "splat-transform v3.7.0"}))) == 6


def test_a_codebook_that_begins_with_null_is_continued_downwards() -> None:
    scene = read(edited(lambda meta: meta["scales"]["codebook"].__setitem__(0, None)))
    values = np.arange(256) / 8 - 4
    assert scene.log_scales[0, 0] == np.float32(values[1] + (values[1] - values[255]) / 255)


@pytest.mark.parametrize(
    ("marks", "said"),
    [
        ({"model": "antialiased"}, RenderModel.ANTIALIASED),
        ({"model": "2dgs"}, RenderModel.TWO_DIMENSIONAL),
        ({"antialias": True}, RenderModel.ANTIALIASED),
        ({"antialias": False}, RenderModel.CLASSIC),
        ({"antialias": True, "model": "default"}, RenderModel.CLASSIC),
    ],
)
def test_the_model_is_told(marks: dict[str, object], said: RenderModel) -> None:
    assert sog.describe(Source(zipped(with_meta(**marks)))).render_model == said
    refuses("input-version", lambda: sog.describe(Source(zipped(with_meta(model="new")))), "'new'", kind=Unsupported)


def test_labels_may_be_listed_first() -> None:
    """The manual once listed labels before centroids; the names decide."""
    np.testing.assert_array_equal(read(edited(lambda meta: meta["shN"]["files"].reverse())).sh, read(sog_files()).sh)


def test_bundle_inside_a_folder_and_deflated() -> None:
    assert len(load(zipped(sog_files(), zipfile.ZIP_DEFLATED, prefix="scene/"))) == 6


def test_file_names_cannot_lead_out_of_the_directory(tmp_path: Path) -> None:
    inside = directory_of(edited(lambda meta: meta["scales"].update(files=["../scales.webp"])), tmp_path)
    (inside / "scales.webp").rename(tmp_path / "scales.webp")
    refuses("input-unreadable", lambda: load(inside))


def directory_of(files: dict[str, bytes], folder: Path) -> Path:
    """An unbundled SOG in a directory of its own."""
    inside = folder / "scene"
    inside.mkdir()
    for name, data in files.items():
        (inside / name).write_bytes(data)
    return inside


@pytest.mark.skipif(os.name != "posix", reason="POSIX pipes, links and devices")
@pytest.mark.parametrize("what", ["pipe", "link to a device", "link to itself", "directory"])
@pytest.mark.parametrize("name", ["scales.webp", "meta.json"])
def test_only_regular_files_of_a_directory_are_read(tmp_path: Path, name: str, what: str) -> None:
    """A pipe would hang, a device never end."""
    inside = directory_of(sog_files(), tmp_path)
    path = inside / name
    path.unlink()
    make = {
        "pipe": lambda: os.mkfifo(path),
        "link to a device": lambda: path.symlink_to("/dev/zero"),
        "link to itself": lambda: path.symlink_to(path),
        "directory": lambda: path.mkdir(),
    }
    make[what]()
    refuses("input-unreadable", lambda: load(inside))


def test_a_directory_is_read_and_links_to_files_are_followed(tmp_path: Path) -> None:
    inside = directory_of(sog_files(), tmp_path)
    (inside / "scales.webp").rename(tmp_path / "elsewhere")
    (inside / "scales.webp").symlink_to(tmp_path / "elsewhere")
    np.testing.assert_array_equal(load(inside).log_scales, read(sog_files()).log_scales)


def test_messages_do_not_name_streams_in_memory() -> None:
    with pytest.raises(InvalidInput, match=r"damaged image \(unknown kind\)") as caught:
        read(sog_files() | {"scales.webp": b"no picture"})
    assert "BytesIO" not in caught.value.message


@pytest.mark.parametrize(
    "changes",
    [
        {"count": -1},
        {"count": True},
        {"count": 7.5},
        {"count": None},
        {"means": None},
        {"means": {"mins": [0, 0], "maxs": [1, 1, 1], "files": ["means_l.webp", "means_u.webp"]}},
        {"means": {"mins": [0, 0, "1"], "maxs": [1, 1, 1], "files": ["means_l.webp", "means_u.webp"]}},
        {"means": {"mins": [0, 0, 10**400], "maxs": [1, 1, 1], "files": ["means_l.webp", "means_u.webp"]}},
        {"scales": {"codebook": [0.0] * 255, "files": ["scales.webp"]}},
        {"scales": {"codebook": [0.0] * 256, "files": ["absent.webp"]}},
        {"scales": {"codebook": [0.0] * 256, "files": [7]}},
        {"scales": {"codebook": [0.0] * 256, "files": []}},
        {"quats": {"files": ["\0"]}},
        {"quats": {"files": ["meta.json"]}},
        {"quats": {"files": ["scales.webp", "sh0.webp"]}, "count": 3},
        {"count": 100},
        {"shN": {"codebook": [0.0] * 256, "bands": 2, "files": ["shN_centroids.webp", "shN_labels.webp"]}},
        {"shN": {"codebook": [0.0] * 256, "files": ["scales.webp", "shN_labels.webp"]}},
    ],
)
def test_metadata_that_does_not_fit_is_refused(changes: dict[str, object]) -> None:
    files = with_meta(**changes)
    if changes.get("count") == 3:
        files["scales.webp"] = webp(np.zeros((2, 4, 4), np.uint8))
    refuses("input-corrupt", lambda: load(zipped(files)))


@pytest.mark.parametrize("version", [3, "2", None])
def test_other_versions_are_unsupported(version: object) -> None:
    refuses("input-version", lambda: load(zipped(with_meta(version=version))), kind=Unsupported)


def test_meta_that_is_not_json_is_refused() -> None:
    for meta in (b"{", b"[]", b"[" * 100_000, b"\xff\xfe"):
        with pytest.raises((InvalidInput, Unsupported)):
            load(zipped(sog_files() | {"meta.json": meta}))


@pytest.mark.parametrize(
    ("name", "pixels", "said"),
    [
        ("shN_labels.webp", np.full((3, 4, 4), 255, np.uint8), "label 65535"),
        ("scales.webp", np.zeros((1200, 1200, 4), np.uint8), "1440000 pixels"),
    ],
)
def test_images_that_do_not_fit_are_refused(name: str, pixels: np.ndarray, said: str) -> None:
    """A label beyond the palette; an image far larger than the scene, before it is decoded."""
    refuses("input-corrupt", lambda: read(sog_files() | {name: webp(pixels)}), said)


def test_meta_json_from_memory_asks_for_its_path() -> None:
    refuses("input-incomplete", lambda: load(sog_files()["meta.json"]))


def _nearest(points: np.ndarray, point: np.ndarray, count: int) -> np.ndarray:
    """Rows of the `count` nearest `points`, in any order."""
    return np.argpartition(((points - point) ** 2).sum(1), count)[:count]


@pytest.mark.scene
def test_real_statues_have_normals_along_their_thin_axis(shared_data: Path) -> None:
    """Guards the quaternion's component order: thin axes lie along the local surface normal, on average."""
    scene = read_scene(shared_data / "splats" / "angel.sog")
    chosen = np.random.default_rng(0).choice(len(scene), 1500, replace=False)
    near = np.array([_nearest(scene.positions, scene.positions[row], 24) for row in chosen])
    around = scene.positions[near] - scene.positions[near].mean(1, keepdims=True)
    normals = np.linalg.eigh(around.transpose(0, 2, 1) @ around)[1][:, :, 0]
    axes = matrix_from_quaternion(scene.rotations[chosen]).transpose(0, 2, 1)
    thin = axes[np.arange(len(chosen)), scene.log_scales[chosen].argmin(1)]
    assert np.abs((thin * normals).sum(1)).mean() > 0.7  # 0.5 for random directions, 0.67 for x, y, z, w order

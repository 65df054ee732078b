"""Spark's `.rad`. Spark 2.2.0 decodes these files to the same Gaussians, within its own rounding."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scarfmt.errors import InputWarning
from scarfmt.formats import load
from scarfmt.formats.quantise import opacities
from scarfmt.scene.gaussians import GaussianScene
from tests.formats.rad_files import Property, centres, chunk, delta, entry, file, lebytes, plain, planes, small
from tests.formats.scene_files import read_scene
from tests.samples.codec_samples import refuses

COUNT = 4
ROW = np.arange(COUNT)[:, None]
BYTES = (ROW * 90 + np.array([0, 100, 255])) % 256
SIZES = np.exp2(ROW + np.array([0.0, -1, 2]))
VECTORS = np.array([[0, 0, 0], [0.5, 0.5, 0.5], [0.5, -0.5, 0.5], [0, -1, 0]])
SIGNED = (np.arange(COUNT * 9).reshape(COUNT, 9) * 7 - 120).clip(-127, 127)
HARMONICS = np.arange(COUNT * 9).reshape(COUNT, 9) / 8 - 2
UNSIGNED = SIGNED % 256

ENCODED: list[tuple[Property, np.ndarray]] = [
    (entry("center", "f32", planes(centres(COUNT), "<f4")), centres(COUNT)),
    (entry("center", "f16", planes(centres(COUNT), "<f2")), centres(COUNT)),
    (entry("center", "f32_lebytes", lebytes(centres(COUNT), "<f4")), centres(COUNT)),
    (entry("center", "f16_lebytes", lebytes(centres(COUNT), "<f2")), centres(COUNT)),
    (entry("alpha", "f32", planes(ROW / 4, "<f4")), (ROW / 4)[:, 0]),
    (entry("alpha", "f16", planes(ROW / 4, "<f2")), (ROW / 4)[:, 0]),
    (entry("alpha", "r8", planes(ROW + 124, "u1"), 0, 2), np.array([248, 250, 252, 254]) / 255),
    (entry("rgb", "f32", planes(VECTORS, "<f4")), VECTORS),
    (entry("rgb", "f16", planes(VECTORS, "<f2")), VECTORS),
    (entry("rgb", "r8", planes(BYTES, "u1"), -0.5, 1.5), BYTES / 255 * 2 - 0.5),
    (entry("rgb", "r8_delta", delta(BYTES), -0.5, 1.5), BYTES / 255 * 2 - 0.5),
    (entry("scales", "f32", planes(SIZES, "<f4")), np.log(SIZES)),
    (entry("scales", "ln_f16", planes(VECTORS * 4, "<f2")), VECTORS * 4),
    (entry("scales", "ln_0r8", planes(BYTES, "u1"), -12, 9), np.where(BYTES, (BYTES - 1) / 254 * 21 - 12, -np.inf)),
    (entry("orientation", "f32", planes(VECTORS, "<f4")), VECTORS),
    (entry("orientation", "f16", planes(VECTORS, "<f2")), VECTORS),
    (entry("sh1", "f32", planes(HARMONICS, "<f4")), HARMONICS),
    (entry("sh1", "f16", planes(HARMONICS, "<f2")), HARMONICS),
    (entry("sh1", "r8", planes(UNSIGNED, "u1"), -1, 3), UNSIGNED / 255 * 4 - 1),
    (entry("sh1", "r8_delta", delta(UNSIGNED), -1, 3), UNSIGNED / 255 * 4 - 1),
    (entry("sh1", "s8", planes(SIGNED, "i1"), -2, 2), SIGNED / 127 * 2),
    (entry("sh1", "s8_delta", delta(SIGNED), -2, 2), SIGNED / 127 * 2),
]  # fmt: skip


def one(*properties: Property, **fields: Any) -> bytes:
    """A file of four Gaussians, some of whose properties are given."""
    known = {said["property"]: said for said in properties}
    return file([chunk(0, COUNT, plain(COUNT, **known))], count=COUNT, **fields)


def values_of(scene: GaussianScene, name: str) -> np.ndarray:
    """A property in the terms of the format."""
    if name == "alpha":
        return opacities(scene.opacity_logits)
    if name == "rgb":
        return np.asarray(0.5 + scene.sh[:, 0] * 0.28209479177387814)
    if name == "sh1":
        return scene.sh[:, 1:].reshape(len(scene), 9)
    return {"center": scene.positions, "scales": scene.log_scales, "orientation": scene.rotations[:, 1:]}[name]


@pytest.mark.parametrize(("stored", "expected"), ENCODED, ids=[f"{p['property']} {p['encoding']}" for p, _ in ENCODED])
def test_every_encoding_is_read_to_its_values(stored: Property, expected: np.ndarray) -> None:
    scene = read_scene(one(stored, maxSh=int(stored["property"] == "sh1")))
    # Opacities of 0 and 1 are read as half a step of float16 from there.
    tolerance = 2.0**-12 if stored["property"] == "alpha" else 1e-6
    np.testing.assert_allclose(values_of(scene, stored["property"]), expected, atol=tolerance)
    np.testing.assert_allclose(np.linalg.norm(scene.rotations, axis=1), 1, atol=1e-6)
    assert (scene.rotations[:, 0] >= 0).all()


@pytest.mark.parametrize(
    ("stored", "axis"),
    [
        ((255, 128, 255), (1, 0, 0)),
        ((0, 128, 255), (-1, 0, 0)),
        ((128, 255, 255), (0, 1, 0)),
        ((128, 128, 255), (0, 0, 1)),
        ((255, 255, 255), (0, 0, -1)),
        ((170, 170, 255), (1, 1, 1)),
        ((213, 213, 255), (1, 1, -1)),
    ],
)
def test_octahedral_axes(stored: tuple[int, int, int], axis: tuple[int, int, int]) -> None:
    bytes_ = entry("orientation", "oct88r8", bytes([128, 128, 0] * 3) + bytes(stored))
    rotations = read_scene(one(bytes_)).rotations
    np.testing.assert_allclose(rotations[:3], [[1, 0, 0, 0]] * 3, atol=1e-7)
    np.testing.assert_allclose(rotations[3], [0, *np.array(axis) / np.linalg.norm(axis)], atol=0.02)


def test_chunks_make_one_scene() -> None:
    scene = read_scene(small())
    np.testing.assert_array_equal(scene.positions, centres(3)[[0, 1, 2, 0, 1]])
    np.testing.assert_allclose(values_of(scene, "sh1")[:3], np.arange(27).reshape(3, 9) / 127 * 2, rtol=1e-6)


def test_degrees_2_and_3_follow_degree_1() -> None:
    bands = [entry(f"sh{band}", "f32", planes(np.full((COUNT, 6 * band + 3), band), "<f4")) for band in (1, 2, 3)]
    scene = read_scene(one(*bands, maxSh=3))
    assert scene.sh[0, 1:, 0].tolist() == [1] * 3 + [2] * 5 + [3] * 7
    assert read_scene(one(*bands, maxSh=2)).sh_degree == 2


@pytest.mark.parametrize(("encoding", "kind"), [("u16", "<u2"), ("u32", "<u4")])
def test_labels_number_the_rows_of_the_tables_of_the_first_chunk(encoding: str, kind: str) -> None:
    table = np.arange(2 * 9).reshape(2, 9) / 4
    labels = [entry("sh_label", encoding, planes(rows, kind)) for rows in ([[1], [0], [1]], [[0], [1]])]
    code = entry("sh1_code", "f32", planes(table, "<f4"))
    chunks = [chunk(0, 3, plain(3, sh1_code=code, sh_label=labels[0])), chunk(3, 2, plain(2, sh_label=labels[1]))]
    scene = read_scene(file(chunks, count=5, maxSh=1, shCodeCount=2))
    np.testing.assert_array_equal(values_of(scene, "sh1"), table[[1, 0, 1, 0, 1]])
    refuses("input-corrupt", lambda: load(file(chunks[:1], count=3, maxSh=1, shCodeCount=1)))


def tree(alpha: Property) -> bytes:
    """A root whose children are a leaf and a node of two leaves: numbers 0, 1, 2, then 3 and 4."""
    counts = entry("child_count", "u16", planes([[2], [0], [2], [0], [0]], "<u2"))
    starts = entry("child_start", "u32", planes([[1], [0], [3], [0], [0]], "<u4"))
    properties = plain(5, alpha=alpha, child_count=counts, child_start=starts)
    return file([chunk(0, 5, properties, lodTree=True)], count=5, lodTree=True)


def test_the_leaves_of_a_tree_are_the_scene() -> None:
    """Bytes reach to 2: opaque leaves are 128, inner nodes more."""
    alpha = entry("alpha", "r8", planes([[255], [128], [200], [127], [0]], "u1"), 0, 2)
    with pytest.warns(InputWarning, match=r"2 of 5 Gaussians are coarser levels"):
        scene = read_scene(tree(alpha))
    np.testing.assert_array_equal(scene.positions, centres(5)[[1, 3, 4]])
    np.testing.assert_allclose(values_of(scene, "alpha"), np.array([254.5, 254, 0.5]) / 255, rtol=1e-5)


@pytest.mark.filterwarnings("ignore:.*coarser levels")
def test_leaves_of_opacities_above_1_are_opaque_and_counted() -> None:
    alpha = entry("alpha", "f16", planes([[2.0], [1.5], [1.2], [1.0], [0.5]], "<f2"))
    with pytest.warns(InputWarning, match=r"1 Gaussians have opacities above 1"):
        scene = read_scene(tree(alpha))
    np.testing.assert_allclose(values_of(scene, "alpha"), [1, 1, 0.5], atol=3e-4)


def test_chunks_in_files_beside_the_head(tmp_path: Path) -> None:
    chunks = [chunk(0, 3, plain(3)), chunk(3, 2, plain(2))]
    path = tmp_path / "scene.rad"
    path.write_bytes(file(chunks, names=["scene-0.radc", "scene-1.radc"], count=5))
    refuses("input-unreadable", lambda: load(path))
    for number, data in enumerate(chunks):
        (tmp_path / f"scene-{number}.radc").write_bytes(data)
    np.testing.assert_array_equal(read_scene(path).positions, read_scene(file(chunks, count=5)).positions)
    refuses("input-incomplete", lambda: load(path.read_bytes()))
    refuses("input-format", lambda: load(tmp_path / "scene-1.radc"))
    path.write_bytes(file(chunks, names=["scene-0.radc", "scene-0.radc"], count=5))
    refuses("input-corrupt", lambda: load(path))
    path.write_bytes(file(chunks, names=["../scene-0.radc", "scene-1.radc"], count=5))
    refuses("input-corrupt", lambda: load(path))


@pytest.mark.parametrize(
    "data",
    [
        file([chunk(0, 1, plain(1))], count=1, version=2),
        file([chunk(0, 1, plain(1), version=2)], count=1),
        file([chunk(0, 1, plain(1))], count=1, type="mesh"),
        file([chunk(0, 1, plain(1))], count=1, maxSh=4),
        one(entry("normal", "f32", bytes(48))),
        one(entry("rgb", "ln_f16", bytes(24))),
        one(entry("rgb", "r16", bytes(24), 0, 1)),
        one(entry("rgb", "f16", bytes(24)) | {"compression": "zstd"}),
    ],
)
def test_what_is_not_known_is_refused_by_name(data: bytes) -> None:
    refuses("input-version", lambda: load(data))


@pytest.mark.parametrize(
    "data",
    [
        small()[:-100],
        small()[:30],
        file([chunk(0, 1, plain(1))], count=2),
        file([chunk(0, 2, plain(2))], count=1),
        file([chunk(1, 1, plain(1))], count=1),
        file([chunk(0, 1, plain(1)[1:])], count=1),
        file([chunk(0, 1, plain(1) + plain(1)[:1])], count=1),
        file([chunk(0, 1, plain(1))], count=1, maxSh=1),
        file([chunk(0, 1, plain(1))], count=1, lodTree=True),
        file([chunk(0, 1, plain(1))], count=1, chunks=[{"offset": -1, "bytes": 8}]),
        file([chunk(0, 1, plain(1))], count=1, chunks=[{"offset": 0, "bytes": 1 << 70}]),
        one(entry("rgb", "r8", planes(BYTES, "u1"))),
        one(entry("rgb", "r8", planes(BYTES, "u1"), 0, 10**400)),
        one(entry("rgb", "r8", planes(BYTES, "u1")[:-1], 0, 1)),
        one(entry("alpha", "f16", b"no deflate")),
        one(entry("sh_label", "u16", bytes(2 * COUNT)), maxSh=1),
        one(entry("child_count", "u16", b"\1\0" * COUNT)),
    ],
)
def test_what_does_not_fit_is_refused(data: bytes) -> None:
    refuses("input-corrupt", lambda: load(data))


def test_more_gaussians_than_the_bytes_unpack_to_are_refused() -> None:
    refuses("input-limit", lambda: load(file([chunk(0, 1, plain(1))], count=10_000_000)))
    code = entry("sh1_code", "f32", b"")
    refuses("input-limit", lambda: load(one(code, maxSh=1, shCodeCount=1 << 60)))

"""Niantic SPZ, and the change of axes."""

from __future__ import annotations

import gzip
import itertools
import struct
from pathlib import Path

import numpy as np
import pytest
import zstandard

from scarfmt.errors import InvalidInput, LimitExceeded, ScarError, Unsupported
from scarfmt.formats import load
from scarfmt.formats.frame import flip_axes
from scarfmt.formats.source import Source
from scarfmt.formats.spz import load as load_spz
from scarfmt.scene.gaussians import GaussianScene
from tests.formats.scene_files import spz, unit_quaternions


@pytest.mark.parametrize("version", [1, 2, 3, 4])
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_fields_as_stored(version: int, degree: int) -> None:
    scene = load_spz(Source(spz(version, 7, degree)), frame="RUB")
    row = np.arange(7)
    np.testing.assert_array_equal(scene.positions, np.stack([row, -row, row / 2], 1))
    np.testing.assert_array_equal(scene.log_scales, np.float32([[-10, 0, 5.9375]] * 7))
    np.testing.assert_allclose(scene.sh[:, 0], [[-1 / 0.3, (128 / 255 - 0.5) / 0.15, 1 / 0.3]] * 7, rtol=1e-6)
    alpha = np.clip(row * 40 % 256, 0.5, 254.5) / 255
    np.testing.assert_allclose(scene.opacity_logits, np.log(alpha / (1 - alpha)), rtol=1e-5)
    expected = unit_quaternions(7)
    expected *= np.sign((expected * scene.rotations).sum(1, keepdims=True))
    # Versions 1 and 2 get w from x, y, z, which near w = 0 turns rounding to 8 bits into a large error.
    np.testing.assert_allclose(scene.rotations[:, 1:], expected[:, 1:], atol=0.005)
    np.testing.assert_allclose(scene.rotations[:, 0], expected[:, 0], atol=0.1 if version < 3 else 2e-3)
    np.testing.assert_allclose(np.linalg.norm(scene.rotations, axis=1), 1, atol=0.01)
    stored = np.arange(7 * 3 * ((degree + 1) ** 2 - 1)) % 256
    np.testing.assert_array_equal(scene.sh[:, 1:].ravel(), (stored - 128) / np.float32(128))


def test_default_frame_is_that_of_inria_files() -> None:
    stored = load_spz(Source(spz(4)), frame="RUB")
    scene = load(spz(4))
    assert isinstance(scene, GaussianScene)
    np.testing.assert_array_equal(scene.positions, stored.positions * [1, -1, -1])


def sh_basis(d: np.ndarray) -> np.ndarray:
    """Degrees 0..3 up to constant factors, which a flip does not change."""
    x, y, z = d
    xx, yy, zz = d * d
    low = [1, y, z, x, x * y, y * z, 2 * zz - xx - yy, x * z, xx - yy]
    odd_in_y = [y * (3 * xx - yy), x * y * z, y * (4 * zz - xx - yy)]
    return np.array(
        [*low, *odd_in_y, z * (2 * zz - 3 * xx - 3 * yy), x * (4 * zz - xx - yy), z * (xx - yy), x * (xx - 3 * yy)]
    )


def rotation_matrix(q: np.ndarray) -> np.ndarray:
    w, v = q[0], q[1:]
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


@pytest.mark.parametrize("signs", list(itertools.product((1, -1), repeat=3)))
def test_flipping_axes_flips_shape_and_colour_with_the_position(signs: tuple[int, int, int]) -> None:
    """The covariance becomes F C F, and the colour seen along F d is that seen along d before."""
    rng = np.random.default_rng(1)
    f32 = np.float32
    scene = GaussianScene(
        rng.normal(size=(4, 3)),
        rng.normal(size=(4, 3)).astype(f32),
        unit_quaternions(4).astype(f32),
        np.zeros(4, f32),
        rng.normal(size=(4, 16, 3)).astype(f32),
    )
    flipped, flip, direction = flip_axes(scene, signs), np.diag(signs), np.array([0.6, 0.48, 0.64])
    for i in range(4):
        before, after = (rotation_matrix(s.rotations[i].astype(float)) for s in (scene, flipped))
        size = np.diag(np.exp(2 * scene.log_scales[i].astype(float)))
        np.testing.assert_allclose(after @ size @ after.T, flip @ before @ size @ before.T @ flip, atol=1e-4)
        seen, expected = sh_basis(flip @ direction) @ flipped.sh[i], sh_basis(direction) @ scene.sh[i]
        np.testing.assert_allclose(seen, expected, atol=1e-5)


@pytest.mark.parametrize("version", [3, 4])
@pytest.mark.parametrize(("system", "signs"), [(6, (1, 1, 1)), (4, (1, -1, -1)), (7, (-1, -1, 1)), (0, (1, -1, -1))])
def test_coordinate_system_extension_is_obeyed(version: int, system: int, signs: tuple[int, ...]) -> None:
    """6 is RDF, 4 RUB, 7 LUF, 0 unspecified; a record of unknown type before it is skipped."""
    extension = struct.pack("<II", 0xADBE0002, 12) + bytes(12) + struct.pack("<III", 0xADBE0003, 4, system)
    scene = load(spz(version, extension=extension))
    assert isinstance(scene, GaussianScene)
    row = np.arange(7)
    np.testing.assert_array_equal(scene.positions, np.stack([row, -row, row / 2], 1) * signs)


def test_axes_that_need_a_turn_are_refused() -> None:
    with pytest.raises(Unsupported) as caught:
        load(spz(4, extension=struct.pack("<III", 0xADBE0003, 4, 16)))
    assert caught.value.refusal == "input-frame"


def test_newer_version_and_degree_are_unsupported_rather_than_damaged() -> None:
    newer = spz(4)[:4] + struct.pack("<I", 5) + spz(4)[8:]
    degree_4 = spz(4)[:12] + b"\x04" + spz(4)[13:]
    for data, refusal in ((newer, "input-version"), (degree_4, "input-sh-degree")):
        with pytest.raises(Unsupported) as caught:
            load(data)
        assert caught.value.refusal == refusal


@pytest.mark.parametrize("count", [10**6, 2**31])
@pytest.mark.parametrize("version", [2, 4])
def test_declared_count_is_checked_before_memory_is_allocated(version: int, count: int) -> None:
    data = spz(version) if version == 4 else gzip.decompress(spz(version))
    data = data[:8] + struct.pack("<I", count) + data[12:]
    with pytest.raises((InvalidInput, LimitExceeded)):
        load(data if version == 4 else gzip.compress(data))


@pytest.mark.parametrize("version", [1, 2, 3, 4])
def test_empty_scene_is_read_as_empty(version: int) -> None:
    assert len(load(spz(version, 0))) == 0


def test_gzip_bomb_is_not_inflated() -> None:
    bomb = gzip.compress(gzip.decompress(spz(2)) + bytes(64 << 20))
    with pytest.raises(InvalidInput) as caught:
        load(bomb)
    assert caught.value.refusal == "input-corrupt"


def test_zstd_frame_of_another_size_is_refused() -> None:
    """The frame's own size is what would be allocated, so it must be the declared one."""
    data = spz(4, degree=0)
    bomb = zstandard.ZstdCompressor().compress(bytes(1 << 20))
    table = 32
    packed = struct.unpack_from("<Q", data, table)[0]
    start = table + 5 * 16
    forged = data[:table] + struct.pack("<Q", len(bomb)) + data[table + 8 : start] + bomb + data[start + packed :]
    with pytest.raises(InvalidInput, match="1048576"):
        load(forged)


@pytest.mark.parametrize("version", [2, 3, 4])
def test_every_cut_is_refused(version: int) -> None:
    data = spz(version)
    for length in range(len(data)):
        with pytest.raises(ScarError):
            load(data[:length], format="spz")


@pytest.mark.scene
def test_the_same_real_figure_in_two_formats(shared_data: Path) -> None:
    """SPZ converted to RDF and compressed PLY agree within SPZ's grid of 1/4096, in shape and colour too."""
    a, b = (load(shared_data / "splats" / f"biker.{kind}") for kind in ("spz", "compressed.ply"))
    assert isinstance(a, GaussianScene)
    assert isinstance(b, GaussianScene)
    assert np.sqrt(((a.positions - b.positions) ** 2).sum(1).mean()) < 0.5 / 4096 * np.sqrt(3)
    cosine = np.abs((a.rotations * b.rotations).sum(1))
    assert np.percentile(cosine, 10) > 0.9999
    assert np.abs(a.sh - b.sh).max() < 0.05
    np.testing.assert_allclose(a.opacity_logits, b.opacity_logits, atol=1e-5)

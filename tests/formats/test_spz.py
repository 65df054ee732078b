"""Niantic SPZ, and the change of axes."""

from __future__ import annotations

import gzip
import io
import itertools
import struct
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import zstandard

from scarfmt.container.registries import RenderModel
from scarfmt.errors import InputWarning, InvalidInput, LimitExceeded
from scarfmt.formats import load
from scarfmt.formats.frame import RUB_TO_RDF, flip_axes
from scarfmt.formats.output import Described
from scarfmt.formats.quantise import opacities
from scarfmt.formats.source import Source
from scarfmt.formats.spz import describe as describe_spz
from scarfmt.formats.spz import write_spz
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.placement import sh_basis
from scarfmt.scene.rotation import matrix_from_quaternion
from tests.formats.scene_files import read_scene, spz, unit_quaternions
from tests.samples.codec_samples import refuses


def stored_axes(data: bytes) -> GaussianScene:
    """The scene of a file in the axes of the format."""
    return flip_axes(read_scene(data), RUB_TO_RDF)


@pytest.mark.parametrize("version", [1, 2, 3, 4])
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_fields_as_stored(version: int, degree: int) -> None:
    scene = stored_axes(spz(version, 7, degree))
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
        before, after = (matrix_from_quaternion(s.rotations[i : i + 1])[0] for s in (scene, flipped))
        size = np.diag(np.exp(2 * scene.log_scales[i].astype(float)))
        np.testing.assert_allclose(after @ size @ after.T, flip @ before @ size @ before.T @ flip, atol=1e-4)
        seen, expected = sh_basis(flip @ direction, 3) @ flipped.sh[i], sh_basis(direction, 3) @ scene.sh[i]
        np.testing.assert_allclose(seen, expected, atol=1e-5)


@pytest.mark.parametrize("version", [3, 4])
@pytest.mark.parametrize(("system", "signs"), [(6, (1, 1, 1)), (4, (1, -1, -1)), (7, (-1, -1, 1)), (0, (1, -1, -1))])
def test_coordinate_system_extension_is_obeyed(version: int, system: int, signs: tuple[int, ...]) -> None:
    """6 is RDF, 4 RUB, 7 LUF, 0 unspecified; a record of unknown type before it is skipped."""
    extension = struct.pack("<II", 0xADBE0002, 12) + bytes(12) + struct.pack("<III", 0xADBE0003, 4, system)
    scene = read_scene(spz(version, extension=extension))
    row = np.arange(7)
    np.testing.assert_array_equal(scene.positions, np.stack([row, -row, row / 2], 1) * signs)


@pytest.mark.parametrize(("system", "signs"), [(12, (1, 1, 1)), (9, (-1, -1, 1)), (14, (1, -1, -1))])
def test_systems_of_a_quarter_turn_are_read_as_the_library_writes_them(system: int, signs: tuple[int, ...]) -> None:
    """12 is RFU; from RUB the library (0.2.3) stores (x, -z, y) times these signs."""
    scene = stored_axes(spz(4, 7, 2, extension=struct.pack("<III", 0xADBE0003, 4, system)))
    stored = stored_axes(spz(4, 7, 2))
    x, y, z = scene.positions.T
    np.testing.assert_allclose(np.stack([x, -z, y], 1) * signs, stored.positions, atol=1e-12)
    turn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]) * np.array(signs)[:, None]
    direction = np.array([0.6, 0.48, 0.64])
    np.testing.assert_allclose(
        sh_basis(direction, 2) @ scene.sh[3], sh_basis(turn @ direction, 2) @ stored.sh[3], atol=1e-4
    )


def test_what_is_not_known_is_refused_by_name() -> None:
    newer = spz(4)[:4] + struct.pack("<I", 5) + spz(4)[8:]
    degree_5 = spz(4)[:12] + b"\x05" + spz(4)[13:]
    flag = spz(4)[:14] + b"\x04" + spz(4)[15:]
    tree = spz(4)[:14] + b"\x80" + spz(4)[15:]
    plain = gzip.decompress(spz(3))
    old_flag = gzip.compress(plain[:14] + b"\x10" + plain[15:])
    extension = spz(4, extension=struct.pack("<II", 0x12340001, 0))
    axes = spz(4, extension=struct.pack("<III", 0xADBE0003, 4, 17))
    for data in (newer, flag, tree, old_flag, extension):
        refuses("input-version", partial(load, data))
    refuses("input-sh-degree", partial(load, degree_5))
    refuses("input-frame", partial(load, axes))


@pytest.mark.parametrize("version", [2, 3, 4])
def test_a_step_that_puts_all_positions_at_zero_is_refused(version: int) -> None:
    """A known writer leaves 255 where it forgets the number of fractional bits."""
    data = spz(version)
    plain = data if version == 4 else gzip.decompress(data)
    forgotten = plain[:13] + b"\xff" + plain[14:]
    refuses("input-corrupt", lambda: load(forgotten if version == 4 else gzip.compress(forgotten)), "all lie at zero")


@pytest.mark.parametrize("version", [3, 4])
def test_degree_four_is_cut_with_a_word(version: int) -> None:
    with pytest.warns(InputWarning, match="degree 4"):
        scene = read_scene(spz(version, 7, 4))
    stored = (np.arange(7 * 72) % 256).reshape(7, 24, 3)[:, :15]
    np.testing.assert_array_equal(np.abs(scene.sh[:, 1:]), np.abs((stored - 128) / np.float32(128)))


def test_the_leaves_of_a_tree_are_the_scene() -> None:
    """Spark's flag 0x80: parents stand for their children, and alphas are of half the opacity."""
    plain = bytearray(gzip.decompress(spz(3, 7, 0)))
    plain[14] = 0x80
    plain[16 + 7 * 9 : 16 + 7 * 10] = bytes([60, 0, 64, 127, 128, 200, 115])
    children = np.array([2, 0, 0, 2, 0, 0, 0], "<u2").tobytes() + np.arange(7, dtype="<u4").tobytes()
    with pytest.warns(InputWarning, match="2 of 7 Gaussians"):
        scene = read_scene(gzip.compress(bytes(plain) + children))
    np.testing.assert_array_equal(scene.positions[:, 0], [1, 2, 4, 5, 6])
    np.testing.assert_allclose(opacities(scene.opacity_logits) * 255, [0.5, 128, 254.5, 254.5, 230], rtol=1e-5)
    refuses("input-corrupt", lambda: load(gzip.compress(bytes(plain) + children[:-1])))


def test_a_scene_trained_with_antialiasing_says_so() -> None:
    for data in (spz(4)[:14] + b"\x01" + spz(4)[15:], gzip.compress(gzip.decompress(spz(2))[:14] + b"\x01" + bytes(9))):
        assert describe_spz(Source(data)).render_model == RenderModel.ANTIALIASED


def test_a_regular_scene_of_few_bytes_is_no_bomb() -> None:
    """Equal Gaussians in rows shrink to less than a byte each."""
    row = np.arange(600_000) % 1000
    ones = np.ones((len(row), 4), np.float32)
    positions = np.stack([row, row, row], 1).astype(np.float64)
    scene = GaussianScene(positions, ones[:, :3], ones, ones[:, 0], np.ones((len(row), 1, 3), np.float32))
    target = io.BytesIO()
    write_spz([scene], Described(0), target)
    assert len(target.getvalue()) < 30_000
    assert len(load(target.getvalue())) == len(row)


@pytest.mark.parametrize("count", [10**6, 2**31])
@pytest.mark.parametrize("version", [2, 4])
def test_declared_count_is_checked_before_memory_is_allocated(version: int, count: int) -> None:
    data = spz(version) if version == 4 else gzip.decompress(spz(version))
    data = data[:8] + struct.pack("<I", count) + data[12:]
    with pytest.raises((InvalidInput, LimitExceeded)):
        load(data if version == 4 else gzip.compress(data))


def test_gzip_bomb_is_not_inflated() -> None:
    bomb = gzip.compress(gzip.decompress(spz(2)) + bytes(64 << 20))
    refuses("input-corrupt", lambda: load(bomb))


def test_zstd_frame_of_another_size_is_refused() -> None:
    """The frame's own size is what would be allocated, so it must be the declared one."""
    data = spz(4, degree=0)
    bomb = zstandard.ZstdCompressor().compress(bytes(1 << 20))
    table = 32
    packed = struct.unpack_from("<Q", data, table)[0]
    start = table + 5 * 16
    forged = data[:table] + struct.pack("<Q", len(bomb)) + data[table + 8 : start] + bomb + data[start + packed :]
    refuses("input-corrupt", lambda: load(forged), "1048576")


@pytest.mark.parametrize("version", [2, 3, 4])
def test_every_cut_is_refused(version: int) -> None:
    data = spz(version)
    for length in range(len(data)):
        refuses("input-corrupt", partial(load, data[:length], format="spz"))
    if version < 4:  # all attributes are there, but not the checksum after them
        refuses("input-corrupt", lambda: load(data[:-8]), "the gzip stream has no end")


@pytest.mark.scene
def test_the_same_real_figure_in_two_formats(shared_data: Path) -> None:
    """SPZ converted to RDF and compressed PLY agree within SPZ's grid of 1/4096, in shape and colour too."""
    a, b = (read_scene(shared_data / "splats" / f"biker.{kind}") for kind in ("spz", "compressed.ply"))
    assert np.sqrt(((a.positions - b.positions) ** 2).sum(1).mean()) < 0.5 / 4096 * np.sqrt(3)
    cosine = np.abs((a.rotations * b.rotations).sum(1))
    assert np.percentile(cosine, 10) > 0.9999
    assert np.abs(a.sh - b.sh).max() < 0.05
    np.testing.assert_allclose(a.opacity_logits, b.opacity_logits, atol=1e-5)

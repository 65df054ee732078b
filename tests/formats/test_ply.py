"""INRIA and compressed PLY."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from scarfmt.errors import InvalidInput, LimitExceeded
from scarfmt.formats import load
from scarfmt.formats.inria_ply import FLAT_LOG_SCALE
from scarfmt.scene.gaussians import GaussianScene
from tests.formats.scene_files import compressed_ply, inria_names, inria_ply, ply, unit_quaternions


def read(data: bytes) -> GaussianScene:
    scene = load(data)
    assert isinstance(scene, GaussianScene)
    return scene


@pytest.mark.parametrize("form", ["little", "big", "ascii"])
@pytest.mark.parametrize("kind", ["float", "double"])
@pytest.mark.parametrize("rest", [0, 9, 24, 45])
def test_every_column_lands_in_its_place(form: str, kind: str, rest: int) -> None:
    """Any type and encoding; f_rest is channel-major in the file, coefficient-major in memory."""
    scene = read(inria_ply(5, rest, kind=kind, form=form))
    names = inria_names(rest)

    def column(name: str) -> np.ndarray:
        return np.arange(5) + names.index(name) / 64

    np.testing.assert_array_equal(scene.positions, np.stack([column(a) for a in "xyz"], 1))
    np.testing.assert_array_equal(scene.log_scales, np.stack([column(f"scale_{i}") for i in range(3)], 1))
    np.testing.assert_array_equal(scene.rotations, np.stack([column(f"rot_{i}") for i in range(4)], 1))
    np.testing.assert_array_equal(scene.opacity_logits, column("opacity"))
    for channel in range(3):
        np.testing.assert_array_equal(scene.sh[:, 0, channel], column(f"f_dc_{channel}"))
        for coefficient in range(rest // 3):
            stored = column(f"f_rest_{channel * (rest // 3) + coefficient}")
            np.testing.assert_array_equal(scene.sh[:, 1 + coefficient, channel], stored)


def test_double_positions_keep_their_precision() -> None:
    names = inria_names(0)
    rows = np.full((1, len(names)), 1e6 + 1e-6)
    assert read(ply([("double", name) for name in names], rows)).positions[0, 0] == 1e6 + 1e-6


def test_other_properties_and_elements_are_ignored() -> None:
    names = inria_names(9)
    properties = [("uchar", "red"), *(("float", name) for name in names), ("int", "label")]
    rows = np.ones((2, len(properties)))
    data = ply(properties, rows, extra="element camera 0\nproperty list uchar int vertex_indices")
    assert len(read(data)) == 2


@pytest.mark.parametrize("form", ["little", "big", "ascii"])
def test_elements_before_the_vertices_are_passed_over(form: str) -> None:
    """Elements with lists are skipped, too, although their rows have any length."""
    order = {"little": "<", "big": ">", "ascii": ""}[form]
    whole = inria_ply(3, 9, form=form)
    head, body = whole.split(b"end_header\n", 1)
    start = head.index(b"element vertex")
    faces = b"element face 2\nproperty list uchar int corners\nproperty double weight\n"
    faces += b"element bare 2\nproperty short a\n"
    if form == "ascii":
        rows = b"3 0 1 2 0.5\n0 1.5\n7\n8\n"
    else:
        rows = struct.pack(f"{order}B3idBd", 3, 0, 1, 2, 0.5, 0, 1.5) + struct.pack(f"{order}2h", 7, 8)
    changed = head[:start] + faces + head[start:] + b"end_header\n" + rows + body
    np.testing.assert_array_equal(read(changed).sh, read(whole).sh)


def test_lists_that_lead_astray_are_refused() -> None:
    """A list of negative length, beyond the end of the file, or among the vertices is refused."""
    whole = inria_ply(3, 9)
    head, body = whole.split(b"end_header\n", 1)
    start = head.index(b"element vertex")
    before = head[:start] + b"element face 1\nproperty list int int corners\n" + head[start:] + b"end_header\n"
    among = head + b"property list uchar uchar extra\nend_header\n" + body + bytes(3)
    for data in (before + struct.pack("<i", -1) + body, before + struct.pack("<i", 1 << 30) + body, among):
        with pytest.raises(InvalidInput) as caught:
            load(data)
        assert caught.value.refusal == "input-corrupt"


@pytest.mark.parametrize("newline", [b"\n", b"\r\n", b"\r"])
def test_any_end_of_line_divides_a_header(newline: bytes) -> None:
    """One for all of it: a row may begin with a byte that looks like another."""
    whole = inria_ply(3, 9)
    head, body = whole.split(b"end_header\n", 1)
    body = b"\n\r\n\r" + body[4:]
    scene = read((head + b"end_header\n").replace(b"\n", newline) + body)
    assert scene.positions[0, 0] == np.frombuffer(body[:4], "<f4")[0]
    np.testing.assert_array_equal(scene.sh, read(whole).sh)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"format binary_little_endian 1.0\n", b""),
        (b"format binary_little_endian 1.0", b"format binary_little_endian 2.0"),
        (b"format binary_little_endian 1.0", b"format binary_middle_endian 1.0"),
        (b"element vertex 3", b"element vertex -3"),
        (b"element vertex 3", b"element vertex 3\nelement vertex 3"),
        (b"property float x", b"property float x\nproperty float x"),
        (b"property float x", b"property quaternion x"),
        (b"property float x", b"nonsense"),
    ],
)
def test_headers_that_break_the_rules_are_refused(old: bytes, new: bytes) -> None:
    whole = inria_ply(3, 9)
    assert old in whole
    with pytest.raises(InvalidInput) as caught:
        load(whole.replace(old, new, 1))
    assert caught.value.refusal == "input-corrupt"


@pytest.mark.parametrize("row", [b"", b"1 2", b"1 2 3 4 5 x", b"# 1"])
def test_text_rows_have_a_number_for_each_property(row: bytes) -> None:
    whole = inria_ply(3, 0, form="ascii")
    lines = whole.split(b"\n")
    lines[-3] = row if row != b"1 2 3 4 5 x" else lines[-3] + b" x"
    with pytest.raises(InvalidInput) as caught:
        load(b"\n".join(lines))
    assert caught.value.refusal == "input-corrupt"


def test_two_dimensional_gaussians_become_flat_disks() -> None:
    scene = read(inria_ply(3, 0, scales=2))
    np.testing.assert_array_equal(scene.log_scales[:, 2], np.float32(FLAT_LOG_SCALE))


def test_not_finite_values_are_kept_for_a_later_check() -> None:
    names = inria_names(0)
    rows = np.zeros((2, len(names)))
    rows[0, 0], rows[1, 5], rows[1, 6] = np.nan, 1e300, -np.inf
    scene = read(ply([("double", name) for name in names], rows))
    assert scene.invalid_rows().all()


def test_empty_scene_is_read_as_empty() -> None:
    assert len(read(inria_ply(0, 9))) == len(read(inria_ply(0, 0))) == len(read(compressed_ply(0, rest=9))) == 0


def test_point_cloud_is_refused_by_that_name() -> None:
    properties = [("float", a) for a in "xyz"] + [("uchar", "red")]
    with pytest.raises(InvalidInput, match="point cloud") as caught:
        load(ply(properties, np.zeros((3, 4))))
    assert caught.value.refusal == "input-not-gaussians"


@pytest.mark.parametrize("rest", [1, 10, 72])
def test_odd_number_of_harmonics_is_refused(rest: int) -> None:
    with pytest.raises(InvalidInput) as caught:
        load(inria_ply(2, rest))
    assert caught.value.refusal == "input-sh-degree"


@pytest.mark.parametrize("form", ["little", "ascii"])
@pytest.mark.parametrize(("count", "error"), [(10**7, InvalidInput), (10**15, LimitExceeded)])
def test_declared_count_is_checked_before_memory_is_allocated(form: str, count: int, error: type[Exception]) -> None:
    data = inria_ply(2, 9, form=form).replace(b"element vertex 2", b"element vertex %d" % count)
    with pytest.raises(error):
        load(data)


@pytest.mark.parametrize("length", [4, 60, 200, -1])
def test_cut_file_is_refused(length: int) -> None:
    for data in (inria_ply(3, 9), compressed_ply(3)):
        with pytest.raises(InvalidInput) as caught:
            load(data[:length], format="ply")
        assert caught.value.refusal in ("input-corrupt", "input-not-gaussians")


@pytest.mark.parametrize("colour_bounds", [True, False])
@pytest.mark.parametrize("rest", [0, 9, 24, 45])
def test_compressed_fields(colour_bounds: bool, rest: int) -> None:
    """Bit fields, chunk bounds, colour bounds of newer files, and harmonics of a compressed PLY."""
    scene = read(compressed_ply(300, colour_bounds=colour_bounds, rest=rest))
    row = np.arange(300)
    offset = np.where(row >= 256, 10.0, 0.0)
    np.testing.assert_allclose(scene.positions[:, 0], -1 + 2 * row / 2047 + offset, atol=1e-6)
    np.testing.assert_allclose(scene.positions[:, 1], -2 + 4 * row / 1023 + offset, atol=1e-6)
    np.testing.assert_allclose(scene.positions[:, 2], 3 - 6 * row / 2047 + offset, atol=1e-6)
    np.testing.assert_allclose(scene.log_scales[:, 0], -8 + 4 * row / 2047, atol=1e-6)
    np.testing.assert_allclose(scene.rotations, unit_quaternions(300), atol=2e-3)
    colour = 0.5 + scene.sh[:, 0] * 0.28209479177387814
    red = (row % 256) / 255
    np.testing.assert_allclose(colour[:, 0], red * 2 - 0.5 if colour_bounds else red, atol=1e-6)
    np.testing.assert_allclose(colour[:, 2], 1.5 if colour_bounds else 1.0, atol=1e-6)
    alpha = np.clip(255 - row % 256, 0.5, 254.5) / 255
    np.testing.assert_allclose(scene.opacity_logits, np.log(alpha / (1 - alpha)), atol=1e-5)
    assert scene.sh.shape[1] == 1 + rest // 3
    if rest:
        assert scene.sh[0, 1, 0] == -4.0
        assert scene.sh[0, 2, 0] == np.float32(((1 + 0.5) / 256 - 0.5) * 8)
        assert scene.sh[0, 1, 1] == np.float32(((rest // 3 + 0.5) / 256 - 0.5) * 8)


def test_compressed_ply_with_too_few_chunks_is_refused() -> None:
    with pytest.raises(InvalidInput, match="1 chunks"):
        load(compressed_ply(300, chunks=1))

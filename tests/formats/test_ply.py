"""INRIA and compressed PLY, and the PLY a viewer opens."""

from __future__ import annotations

import struct
import warnings
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from scarfmt.container.registries import RenderModel
from scarfmt.errors import InputWarning, InvalidInput, LimitExceeded
from scarfmt.formats import load
from scarfmt.formats.quantise import FLAT_LOG_SCALE
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import GaussianScene
from tests.formats.scene_files import (
    compressed_ply,
    inria_names,
    inria_ply,
    ply,
    read_scene,
    scene_ply,
    unit_quaternions,
)
from tests.samples.codec_samples import refuses


@pytest.mark.parametrize("form", ["little", "big", "ascii"])
@pytest.mark.parametrize("kind", ["float", "double"])
@pytest.mark.parametrize("rest", [0, 9, 24, 45])
def test_every_column_lands_in_its_place(form: str, kind: str, rest: int) -> None:
    """Any type and encoding; f_rest is channel-major in the file, coefficient-major in memory."""
    scene = read_scene(inria_ply(5, rest, kind=kind, form=form))
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
    data = ply([("double", name) for name in names], np.full((1, len(names)), 1e6 + 1e-6))
    assert read_scene(data).positions[0, 0] == 1e6 + 1e-6


def test_normals_colours_and_other_elements_are_passed_over() -> None:
    properties = [(kind, name) for kind, name in (("uchar", "red"), ("float", "nx"))]
    properties += [("float", name) for name in inria_names(9)]
    rows = np.ones((2, len(properties)))
    data = ply(properties, rows, extra="element camera 0\nproperty list uchar int vertex_indices")
    assert len(read_scene(data)) == 2


def test_columns_that_may_say_more_are_named() -> None:
    """Scenes that move have such columns: what stands in a row is one moment of it."""
    more = ["trbf_center", "motion_0", "motion_1", "motion_2", "omega_0"]
    names = inria_names(0) + more
    with pytest.warns(InputWarning, match="columns trbf_center, motion_0, motion_1, motion_2 and 1 more"):
        assert len(read_scene(ply([("float", name) for name in names], np.ones((2, len(names)))))) == 2


def test_one_scale_is_that_of_every_axis() -> None:
    scene = read_scene(inria_ply(5, 9, scales=1))
    scale = np.arange(5) + inria_names(9, 1).index("scale_0") / 64
    np.testing.assert_array_equal(scene.log_scales, np.stack([scale] * 3, axis=1))
    assert scene.description.render_model == RenderModel.CLASSIC


def test_numbers_as_renderers_use_them_are_told() -> None:
    """Tools that write these have sizes of 0.01, so spheres of 1 unit and more; others opacities of 0 to 1 alone."""
    rng = np.random.default_rng(1)
    names = inria_names(0)
    rows = rng.uniform(0.001, 0.5, (40, len(names)))
    opacity, sizes = names.index("opacity"), [names.index(f"scale_{i}") for i in range(3)]

    def read() -> list[str]:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            load(ply([("float", name) for name in names], rows))
        return [str(warning.message).partition("; ")[0].removeprefix("<bytes>: ") for warning in caught]

    assert read() == ["all opacities lie from 0 to 1"]
    rows[:, sizes] = -4
    assert read() == ["all opacities lie from 0 to 1"]
    rows[:, opacity] = 0  # as of points whose training has not begun
    assert read() == []
    rows[:, opacity] = rng.normal(size=40)
    assert read() == []
    rows[:, sizes] = 0.5
    assert read() == ["most Gaussians are wider than the scene"]


COLOURED = [name for name in inria_names(0) if not name.startswith("f_dc")] + ["red", "green", "blue"]
REFUSED: dict[str, tuple[bytes, str, str]] = {
    "no vertices": (inria_ply().replace(b"element vertex", b"element splat"), "input-not-gaussians", "a PLY of splat"),
    "a middle scale": (inria_ply(5, 0).replace(b"scale_1", b"other_1"), "input-not-gaussians", "lack scale_1"),
    "a point cloud": (ply([("float", axis) for axis in "xyz"], np.zeros((3, 3))), "input-not-gaussians", "point cloud"),
    "colours without a range": (
        ply([("float", name) for name in COLOURED], np.zeros((1, len(COLOURED)))),
        "input-not-gaussians",
        "red, green and blue of type float",
    ),
    "too few chunks": (compressed_ply(300, chunks=1), "input-corrupt", "1 chunks"),
    **{f"{rest} harmonics": (inria_ply(2, rest), "input-sh-degree", "") for rest in (1, 10, 75)},
    **{
        f"type {kind}": (inria_ply(2, 0).replace(b"float op", f"{kind} op".encode()), "input-format", f"type '{kind}'")
        for kind in ("half", "float16", "int64", "bool")
    },
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_read_is_refused_by_name(name: str) -> None:
    """Types that PLY lacks are named, not called damage."""
    data, refusal, said = REFUSED[name]
    refuses(refusal, lambda: load(data), said or None)


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
        rows = struct.pack(f"{order}B3idBd2h", 3, 0, 1, 2, 0.5, 0, 1.5, 7, 8)
    changed = head[:start] + faces + head[start:] + b"end_header\n" + rows + body
    np.testing.assert_array_equal(read_scene(changed).sh, read_scene(whole).sh)


def test_lists_that_lead_astray_are_refused() -> None:
    """A list of negative length, beyond the end of the file, or among the vertices is refused."""
    whole = inria_ply(3, 9)
    head, body = whole.split(b"end_header\n", 1)
    start = head.index(b"element vertex")
    before = head[:start] + b"element face 1\nproperty list int int corners\n" + head[start:] + b"end_header\n"
    among = head + b"property list uchar uchar extra\nend_header\n" + body + bytes(3)
    for data in (before + struct.pack("<i", -1) + body, before + struct.pack("<i", 1 << 30) + body):
        refuses("input-corrupt", partial(load, data))
    refuses("input-format", partial(load, among))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"format binary_little_endian 1.0\n", b""),
        (b"format binary_little_endian 1.0", b"format binary_little_endian 2.0"),
        (b"format binary_little_endian 1.0", b"format binary_middle_endian 1.0"),
        (b"element vertex 3", b"element vertex -3"),
        (b"element vertex 3", b"element vertex 3\nelement vertex 3"),
        (b"property float x", b"property float x\nproperty float x"),
        (b"property float x", b"nonsense"),
    ],
)
def test_headers_that_break_the_rules_are_refused(old: bytes, new: bytes) -> None:
    whole = inria_ply(3, 9)
    assert old in whole
    refuses("input-corrupt", lambda: load(whole.replace(old, new, 1)))


@pytest.mark.parametrize("row", [b"", b"1 2", b"1 2 3 4 5 x", b"# 1"])
def test_text_rows_have_a_number_for_each_property(row: bytes) -> None:
    whole = inria_ply(3, 0, form="ascii")
    lines = whole.split(b"\n")
    lines[-3] = row if row != b"1 2 3 4 5 x" else lines[-3] + b" x"
    refuses("input-corrupt", lambda: load(b"\n".join(lines)))
    with pytest.raises(InvalidInput) as caught:
        load(b"\n".join(lines))
    assert "usecols" not in str(caught.value)


def test_two_dimensional_gaussians_become_flat_disks() -> None:
    scene = read_scene(inria_ply(3, 0, scales=2))
    np.testing.assert_array_equal(scene.log_scales[:, 2], np.float32(FLAT_LOG_SCALE))
    assert scene.description.render_model == RenderModel.TWO_DIMENSIONAL


@pytest.mark.parametrize("form", ["little", "ascii"])
@pytest.mark.parametrize(("count", "error"), [(10**7, InvalidInput), (10**15, LimitExceeded)])
def test_declared_count_is_checked_before_memory_is_allocated(form: str, count: int, error: type[Exception]) -> None:
    data = inria_ply(2, 9, form=form).replace(b"element vertex 2", b"element vertex %d" % count)
    with pytest.raises(error):
        load(data)


@pytest.mark.parametrize("form", ["little", "big", "ascii"])
def test_rows_beyond_those_declared_are_told_of(form: str) -> None:
    data = inria_ply(3, 9, form=form)
    with pytest.warns(InputWarning, match="not read"):
        assert len(read_scene(data.replace(b"element vertex 3", b"element vertex 2"))) == 2
    assert len(read_scene(data + b"\n")) == 3


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
    scene = read_scene(compressed_ply(300, colour_bounds=colour_bounds, rest=rest))
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


FIELDS = ("log_scales", "rotations", "opacity_logits", "sh")


@st.composite
def scenes(draw: st.DrawFn) -> GaussianScene:
    """Any float32 values: zeros of both signs, subnormals, infinities and NaN with any payload."""
    count, degree = draw(st.integers(0, 4)), draw(st.integers(0, 3))

    def values(*shape: int) -> np.ndarray:
        return draw(arrays(np.uint32, shape, elements=st.integers(0, 2**32 - 1))).view(np.float32)

    numbers = st.floats(width=32, allow_nan=False)
    positions = draw(arrays(np.float64, (count, 3), elements=numbers))
    sh = values(count, (degree + 1) ** 2, 3)
    return GaussianScene(positions, values(count, 3), values(count, 4), values(count), sh)


def small_scene() -> GaussianScene:
    f32 = np.float32
    values = np.arange(2 * 48, dtype=f32).reshape(2, 16, 3)
    quaternions = np.tile(f32([1, 2, 3, 4]), (2, 1))
    return GaussianScene(np.array([[1.0, 2, 3], [4, 5, 6]]), f32(-np.ones((2, 3))), quaternions, f32([7, 8]), values)


@given(scenes())
def test_import_of_export_is_the_same_bits(scene: GaussianScene) -> None:
    back = read_scene(scene_ply(scene))
    assert back.positions.tobytes() == scene.positions.tobytes()
    for name in FIELDS:
        assert getattr(back, name).tobytes() == getattr(scene, name).tobytes(), name
        assert getattr(back, name).shape == getattr(scene, name).shape


def test_bytes_are_those_viewers_expect() -> None:
    """Header line by line, and the column order of INRIA's trainer: f_rest all of red first."""
    head, body = scene_ply(small_scene(), ["made by a test"]).split(b"end_header\n")
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *(f"f_rest_{i}" for i in range(45))]
    names += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    lines = ["ply", "format binary_little_endian 1.0", "comment made by a test", "element vertex 2"]
    assert head.decode().splitlines() == lines + [f"property float {name}" for name in names]
    row = np.frombuffer(body, "<f4").reshape(2, 62)[1]
    sh = np.arange(48, 96).reshape(16, 3)
    np.testing.assert_array_equal(row, [4, 5, 6, 0, 0, 0, *sh[0], *sh[1:].T.ravel(), 8, -1, -1, -1, 1, 2, 3, 4])


def test_position_beyond_float32_becomes_infinite_without_a_warning() -> None:
    scene = small_scene()
    scene.positions[0, 0] = 1e300
    with np.errstate(all="raise"):
        data = scene_ply(scene)
    assert read_scene(data).positions[0, 0] == np.inf


@pytest.mark.parametrize("comment", ["two\nlines", "end\r", "caf\u00e9"])
def test_comment_cannot_break_the_header(comment: str) -> None:
    refuses("output-comment", lambda: scene_ply(small_scene(), [comment]))


def test_a_degree_above_three_is_cut_with_a_word() -> None:
    """f_rest is channel-major: what is left out lies inside the columns, not at their end."""
    whole = inria_ply(4, 72)
    with pytest.warns(InputWarning, match="degree 4"):
        scene = read_scene(whole)
    names = inria_names(72)
    for channel, coefficient in ((0, 0), (1, 0), (2, 14)):
        stored = np.arange(4) + names.index(f"f_rest_{24 * channel + coefficient}") / 64
        np.testing.assert_array_equal(scene.sh[:, 1 + coefficient, channel], stored)
    assert scene.sh_degree == 3


@pytest.mark.parametrize(("kind", "largest"), [("uchar", 255), ("ushort", 65535)])
def test_colours_of_red_green_and_blue_are_read(kind: str, largest: int) -> None:
    names = [name for name in inria_names(0) if not name.startswith("f_dc")]
    rows = np.zeros((3, len(names) + 3))
    rows[:, -3:] = [[0, largest, largest / 5], [largest, 0, 0], [0, 0, 0]]
    data = ply([("float", name) for name in names] + [(kind, name) for name in ("red", "green", "blue")], rows)
    with pytest.warns(InputWarning, match="red, green and blue"):
        scene = read_scene(data)
    np.testing.assert_allclose(0.5 + scene.sh[:, 0] * 0.28209479, rows[:, -3:] / largest, atol=1e-6)


def test_the_filter_of_mip_splatting_is_applied() -> None:
    """Sizes grow by it, and the opacity shrinks so that each Gaussian covers as much as before."""
    names = [*inria_names(0), "filter_3D"]
    rows = np.zeros((2, len(names)))
    rows[:, names.index("scale_0") : names.index("scale_0") + 3] = np.log([[0.3, 0.4, 0.5], [0.1, 0.1, 0.1]])
    rows[:, -1] = 0.4, 0.0
    scene = read_scene(ply([("double", name) for name in names], rows))
    assert scene.description.render_model == RenderModel.ANTIALIASED
    wider = np.array([[0.5, np.sqrt(0.32), np.sqrt(0.41)], [0.1, 0.1, 0.1]])
    np.testing.assert_allclose(np.exp(scene.log_scales), wider, rtol=1e-6)
    fainter = 0.5 * np.array([0.3 * 0.4 * 0.5 / wider[0].prod(), 1.0])
    np.testing.assert_allclose(1 / (1 + np.exp(-scene.opacity_logits)), fainter, rtol=1e-6)


HEADS = {
    "first line CRLF": lambda head: head.replace(b"ply\n", b"ply\r\n", 1),
    "all but the last CRLF": lambda head: head.replace(b"\n", b"\r\n")[:-2] + b"\n",
    "only the last CRLF": lambda head: head[:-1] + b"\r\n",
    "all CRLF": lambda head: head.replace(b"\n", b"\r\n"),
    "CR alone": lambda head: head.replace(b"\n", b"\r"),
    "a comment in UTF-8": lambda head: head.replace(b"made for a test", "für élève 火".encode()),
    "a comment in Latin-1": lambda head: head.replace(b"made for a test", b"f\xfcr"),
    "comments and obj_info everywhere": lambda head: (
        head.replace(b"ply\n", b"ply\ncomment a\nobj_info b\n", 1).replace(b"end_header", b"comment c\nend_header")
    ),
    "a long header": lambda head: head.replace(b"property", b"comment x\n" * 10_000 + b"property", 1),
    "a line of nothing": lambda head: head.replace(b"element", b"\nelement", 1),
}


@pytest.mark.parametrize("change", HEADS)
@pytest.mark.parametrize("first_byte", [0x0A, 0x0D, 0x41])
def test_headers_of_all_dialects_are_read(change: str, first_byte: int) -> None:
    """The rows may begin with bytes that look like the end of a line."""
    data = inria_ply(4, 9)
    at = data.index(b"end_header\n") + len(b"end_header\n")
    body = bytes([first_byte]) + data[at + 1 :]
    np.testing.assert_array_equal(
        read_scene(HEADS[change](data[:at]) + body).positions, read_scene(data[:at] + body).positions
    )


def test_an_element_without_properties_is_passed_over() -> None:
    """gsplat's exporter writes one for harmonics of degree 0, whose rows are of no bytes."""
    data = compressed_ply(300)
    at = data.index(b"end_header")
    assert len(read_scene(data[:at] + b"element sh 300\n" + data[at:])) == 300


@pytest.mark.parametrize(
    ("comment", "said"),
    [
        ("SplatRenderMode: mip", {"render_model": RenderModel.ANTIALIASED}),
        ("SplatRenderMode:mip", {"render_model": RenderModel.ANTIALIASED}),
        ("antialiased 1", {"render_model": RenderModel.ANTIALIASED}),
        ("splatrendermode: 2dgs", {"render_model": RenderModel.TWO_DIMENSIONAL}),
        ("Vertical Axis: z", {"up_axis": "z"}),
        ("Vertical axis: 0 -1 0", {"up_axis": "-y"}),
        ("Vertical axis: y", {}),
        ("epsg 32650", {"coordinate_reference": "EPSG:32650"}),
        ("offsety 4e5", {"origin": (0.0, 4e5, 0.0)}),
        ("epsg nonsense", {}),
        ("offsetx", {}),
    ],
)
def test_comments_that_say_something_are_heard(comment: str, said: dict[str, Any]) -> None:
    data = inria_ply(1, 0).replace(b"made for a test", comment.encode())
    assert load(data).description == Description(**said)


def test_a_render_model_that_is_not_known_is_named() -> None:
    with pytest.warns(InputWarning, match="SplatRenderMode: new"):
        load(inria_ply(1, 0).replace(b"made for a test", b"SplatRenderMode: new"))

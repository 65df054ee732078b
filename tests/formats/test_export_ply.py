"""The PLY a viewer opens."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from scarfmt.errors import InvalidInput
from scarfmt.formats import load
from scarfmt.formats.export_ply import write_inria_ply
from scarfmt.scene.gaussians import GaussianScene

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


@settings(deadline=None)
@given(scenes())
def test_import_of_export_is_the_same_bits(scene: GaussianScene) -> None:
    out = io.BytesIO()
    write_inria_ply(scene, out)
    back = load(out.getvalue())
    assert isinstance(back, GaussianScene)
    assert back.positions.tobytes() == scene.positions.tobytes()
    for name in FIELDS:
        assert getattr(back, name).tobytes() == getattr(scene, name).tobytes(), name
        assert getattr(back, name).shape == getattr(scene, name).shape


def test_bytes_are_those_viewers_expect() -> None:
    """Header line by line, and the column order of INRIA's trainer: f_rest all of red first."""
    out = io.BytesIO()
    write_inria_ply(small_scene(), out, comments=["made by a test"])
    head, body = out.getvalue().split(b"end_header\n")
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
    out = io.BytesIO()
    with np.errstate(all="raise"):
        write_inria_ply(scene, out)
    back = load(out.getvalue())
    assert isinstance(back, GaussianScene)
    assert back.positions[0, 0] == np.inf


@pytest.mark.parametrize("comment", ["two\nlines", "end\r", "caf\u00e9"])
def test_comment_cannot_break_the_header(comment: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        write_inria_ply(small_scene(), io.BytesIO(), comments=[comment])
    assert caught.value.refusal == "output-comment"


def test_path_is_not_overwritten_unless_forced(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply"
    write_inria_ply(small_scene(), path)
    with pytest.raises(InvalidInput) as caught:
        write_inria_ply(small_scene().take(np.array([0])), path)
    assert caught.value.refusal == "output-exists"
    assert len(load(path)) == 2
    write_inria_ply(small_scene().take(np.array([0])), path, force=True)
    assert len(load(path)) == 1

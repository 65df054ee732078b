"""antimatter15's .splat."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from scarfmt.formats import load
from tests.formats.scene_files import read_scene, splat
from tests.samples.codec_samples import refuses


def test_fields() -> None:
    scene = read_scene(splat(4), format="splat")
    np.testing.assert_array_equal(scene.positions, [[i, -i, 0.5] for i in range(4)])
    np.testing.assert_allclose(scene.log_scales, [[0, 1, -1]] * 4, atol=1e-6)
    np.testing.assert_array_equal(scene.rotations, np.float32([[127 / 128, 0, -1, -0.5]] * 4))
    np.testing.assert_allclose(0.5 + scene.sh[:, 0] * 0.28209479177387814, [[0, 1, 0.2]] * 4, atol=1e-6)
    assert scene.opacity_logits[1] == -scene.opacity_logits[0] == pytest.approx(np.log(254.5 / 0.5), rel=1e-6)


def test_scale_without_logarithm_is_not_clamped() -> None:
    row = struct.pack("<6f", 0, 0, 0, 0.0, -1.0, 1.0) + bytes(8)
    scene = read_scene(row, format="splat")
    assert scene.log_scales[0, 0] == -np.inf
    assert np.isnan(scene.log_scales[0, 1])


def test_partial_row_is_refused() -> None:
    refuses("input-corrupt", lambda: load(splat(2)[:-1], format="splat"), "32-byte")

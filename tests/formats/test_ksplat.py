"""GaussianSplats3D's `.ksplat`."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from scarfmt.errors import InvalidInput
from scarfmt.formats import load
from tests.formats.scene_files import ksplat, read_scene, unit_quaternions
from tests.samples.codec_samples import refuses


@pytest.mark.parametrize("level", [0, 1, 2])
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_fields_as_stored(level: int, degree: int) -> None:
    scene = read_scene(ksplat((degree,), level))
    row = np.arange(5)
    places = row[:, None] + np.arange(3)
    if level:
        centres = np.where(row[:, None] < 3, [[10, 20, 30]], [[-10, -20, -30]])
        places = centres + row[:, None] * 2.5 / 32767
    np.testing.assert_allclose(scene.positions, places, rtol=1e-12)
    np.testing.assert_allclose(scene.log_scales, np.log([[0.5, 1, 2]] * 5), rtol=1e-6)
    np.testing.assert_allclose(scene.rotations, unit_quaternions(5), atol=1e-3)
    np.testing.assert_allclose(0.5 + scene.sh[:, 0] * 0.28209479, [[0, 1, 0.2]] * 5, atol=1e-6)
    np.testing.assert_allclose(1 / (1 + np.exp(-scene.opacity_logits)), 128 / 255, rtol=1e-6)
    assert scene.sh_degree == degree
    for band, first in ((1, 0), (2, 9), (3, 24)):
        if band <= degree:
            stored = first + np.arange(3 * (2 * band + 1)).reshape(3, -1).T
            expected = stored if level < 2 else -1 + 4 * stored / 255
            np.testing.assert_allclose(scene.sh[:, band**2 : (band + 1) ** 2], [expected] * 5, rtol=1e-6)


def test_sections_of_all_degrees_make_one_scene() -> None:
    scene = read_scene(ksplat((0, 2)))
    assert (len(scene), scene.sh_degree) == (10, 2)
    assert not scene.sh[:5, 1:].any()


@pytest.mark.parametrize(
    ("offset", "value", "refusal"),
    [
        (1, b"\x02", "input-version"),
        (20, b"\x03", "input-version"),
        (16, struct.pack("<I", 6), "input-corrupt"),
        (4096 + 40, b"\x04", "input-corrupt"),
        (4096 + 12, struct.pack("<I", 1), "input-corrupt"),
        (4096 + 4, struct.pack("<I", 1 << 31), "input-corrupt"),
        (4096 + 1024, struct.pack("<I", 1), "input-corrupt"),
        (4096 + 32, struct.pack("<I", 1 << 16), "input-corrupt"),
    ],
)
def test_headers_that_do_not_fit_are_refused(offset: int, value: bytes, refusal: str) -> None:
    data = ksplat()
    changed = data[:offset] + value + data[offset + len(value) :]
    refuses(refusal, lambda: load(changed, format="ksplat"))


def test_a_cut_file_is_refused_in_one_sentence() -> None:
    with pytest.raises(InvalidInput) as caught:
        load(ksplat()[:-3], format="ksplat")
    assert caught.value.message.count("get an undamaged copy") == 1

"""Values beyond binary32, and degrees of scenes; the vectors hold the exact values of SPEC §9.1-9.2."""

from __future__ import annotations

import numpy as np

from fuzz.testing.scenes import random_scene
from reference_decoder.decode import decode
from scarfmt.codecs.channels import channel_values, in_binary32
from scarfmt.coding.writer import write_scene
from scarfmt.scene.gaussians import GaussianScene


def test_value_beyond_binary32_becomes_infinite_without_a_warning() -> None:
    with np.errstate(all="raise"):
        assert np.isinf(channel_values(np.array([[1 << 30]], np.int32), (1e300,), np.array([1])))
    assert in_binary32(np.array([[[2, -3, 0]]], np.int32), np.array((0.5, 1.0, 1.0))).tolist() == [[[1.0, -3.0, 0.0]]]


def test_scene_has_the_degree_of_the_file_also_before_any_latent() -> None:
    for degree in range(4):
        data = write_scene(random_scene(9, sh_degree=degree, layers=4))
        for layers in range(1, 5):
            scene = decode(data, layers=layers).scene
            assert isinstance(scene, GaussianScene)
            assert scene.sh_degree == degree

"""Small sound files that the tests of this folder damage."""

from __future__ import annotations

import pytest

from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile


@pytest.fixture(scope="session")
def small_files() -> list[bytes]:
    """Files of both profiles, with and without networks, of a few kB."""
    makers = (random_scene, neural_scene)
    return [
        write_scene(make(seed, profile, anchors=8 * seed, layers=1 + seed % 3, tiles=2))
        for make in makers
        for profile in Profile
        for seed in range(1, 4)
    ]

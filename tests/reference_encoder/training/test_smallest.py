"""The networks of a file: each must pay for its bytes; the same seed gives the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fuzz.testing.scenes import random_scene
from reference_encoder.training.index_entropy import JointIndexModel
from reference_encoder.training.smallest import smallest_file, with_predictors, within_limits
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.directory import local_bits
from scarfmt.container.morton import deinterleave
from scarfmt.container.schema import Profile
from scarfmt.container.source import BytesSource
from scarfmt.limits import Limits


@pytest.fixture(scope="module")
def scene() -> QuantisedScene:
    """Anchors whose values change slowly over space: neighbours predict them well."""
    plain = random_scene(1, Profile.ANCHOR, anchors=6000, tiles=2)
    return replace(plain, contents=tuple(_smooth(plain, tile) for tile in range(2)))


def _smooth(scene: QuantisedScene, tile: int) -> TileContent:
    content, depth = scene.contents[tile], local_bits(scene.fields, scene.tiles[tile])
    place = deinterleave(content.codes) / 2**depth
    noise = np.random.default_rng(tile)
    values = [
        np.rint(9 * np.sin(5 * place[:, :1] + np.arange(part.shape[1])) + noise.normal(0, 0.3, part.shape))
        if part.ndim == 2
        else part
        for part in content.values
    ]
    return replace(content, values=[part.astype(np.int32) for part in values])


@pytest.fixture(scope="module")
def smallest(scene: QuantisedScene) -> bytes:
    return smallest_file(scene, None)


def test_predictors_make_a_file_smaller_where_neighbours_tell_something(scene: QuantisedScene, smallest: bytes) -> None:
    assert any(SceneReader(BytesSource(smallest)).models().predictors)
    assert len(smallest) < 0.99 * len(write_scene(scene))


def test_a_file_that_asks_readers_for_too_much_is_found(smallest: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    """SPEC R-13.2-2: networks beyond the limit of work, in whichever layer it is cut."""
    assert within_limits(smallest)
    monkeypatch.setattr("scarfmt.coding.work.FREE_WORK", 0)
    assert not within_limits(smallest, Limits(work_per_byte=1))


@pytest.mark.parametrize(("profile", "seed"), [(Profile.EXPLICIT, 1), (Profile.ANCHOR, 2)])
def test_noise_is_never_made_larger(profile: Profile, seed: int) -> None:
    """If there is nothing to predict, the static file is returned as it is."""
    noise = random_scene(seed, profile, anchors=400)
    assert len(smallest_file(noise, JointIndexModel())) <= len(write_scene(noise))
    assert with_predictors(noise) is None or profile is Profile.ANCHOR

"""Whole files in which integer networks code symbols (SPEC §10): what is written is read, by whatever path."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.strategies import neural_scenes
from reference_decoder.decode import decode
from scarfmt.coding.reader import ALL_STREAMS, SceneReader
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.schema import Profile, Stream
from scarfmt.container.source import BytesSource
from scarfmt.scene.model import MAX_COMPONENTS
from tests.samples.contents import read_everything
from tests.samples.equality import same

SUBSETS = st.sets(st.sampled_from(sorted(ALL_STREAMS)))


@settings(max_examples=6)
@given(st.integers(0, 2**32 - 1), st.sampled_from(Profile), st.integers(1, MAX_COMPONENTS), st.booleans())
@example(2, Profile.EXPLICIT, MAX_COMPONENTS, False)
@example(5, Profile.ANCHOR, MAX_COMPONENTS, True)
def test_predictors_of_latents_are_the_same_everywhere(seed: int, profile: Profile, size: int, network: bool) -> None:
    """The C library reads latents of any width, with and without an index network, as the definition does."""
    scene = neural_scene(seed, profile, anchors=60, latent=size, network=network)
    data = write_scene(scene)
    assert same(read_everything(data), scene.contents)
    both = [decode(data, native=native).arrays() for native in (True, False)]
    assert all(map(np.array_equal, *both))


@settings(max_examples=6)
@given(neural_scenes(max_anchors=40), SUBSETS)
def test_what_contexts_need_is_decoded_with_what_is_asked_for(scene: QuantisedScene, wanted: set[Stream]) -> None:
    """A predictor of a late layer may look at what only an early one sends."""
    reader = SceneReader(BytesSource(write_scene(scene)))
    for tile, content in reader.tiles(reader.models(), streams=wanted):
        if Stream.INDICES in wanted:
            assert np.array_equal(content.indices, scene.contents[tile].indices)
        for index, channel in enumerate(scene.model.channels):
            if channel.stream in wanted:
                assert np.array_equal(content.values[index], scene.contents[tile].values[index])

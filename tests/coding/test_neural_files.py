"""Whole files in which integer networks code symbols (SPEC §10): what is written is read, by whatever path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from conformance.surgery.files import blocks_of, rebuilt
from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.strategies import neural_scenes
from reference_decoder.decode import decode
from scarfmt.coding.reader import ALL_STREAMS, SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene, keep_layers, write_scene
from scarfmt.container.schema import BlockKind, Profile, Stream
from scarfmt.container.source import BytesSource
from scarfmt.errors import ScarError
from scarfmt.scene.model import MAX_COMPONENTS
from scarfmt.tools.truncate import truncate
from scarfmt.tools.validate import validate
from tests.samples.equality import same

SUBSETS = st.sets(st.sampled_from(sorted(ALL_STREAMS)))


def read(data: bytes, layers: int | None = None) -> list[TileContent]:
    reader = SceneReader(BytesSource(data))
    return [content for _, content in reader.tiles(reader.models(layers))]


@settings(deadline=None, max_examples=15)
@given(neural_scenes())
def test_what_networks_coded_comes_back(scene: QuantisedScene) -> None:
    """Predictors, index network and grid, both profiles, after every layer; and cutting is writing less."""
    data = write_scene(scene)
    for layers in range(1, len(scene.model.layers) + 1):
        kept = keep_layers(scene, layers)
        assert same(read(data, layers), kept.contents)
        assert truncate(BytesSource(data), layers) == write_scene(kept)


@settings(deadline=None, max_examples=12)
@given(st.integers(0, 2**32 - 1), st.sampled_from(Profile), st.integers(1, MAX_COMPONENTS), st.booleans())
@example(2, Profile.EXPLICIT, MAX_COMPONENTS, False)
@example(5, Profile.ANCHOR, MAX_COMPONENTS, True)
def test_predictors_of_latents_are_the_same_everywhere(seed: int, profile: Profile, size: int, network: bool) -> None:
    """The C library reads latents of any width, with and without an index network, as the definition does."""
    scene = neural_scene(seed, profile, anchors=60, latent=size, network=network)
    data = write_scene(scene)
    assert same(read(data), scene.contents)
    both = [decode(data, native=native).arrays() for native in (True, False)]
    assert all(map(np.array_equal, *both))


@settings(deadline=None, max_examples=12)
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


@pytest.mark.parametrize("profile", Profile)
def test_files_with_networks_are_valid(profile: Profile) -> None:
    """The validator reads what the writer writes, and counts their blocks."""
    scene = neural_scene(3, profile)
    assert scene.network is not None
    result = validate(BytesSource(write_scene(scene)))
    assert not [finding for finding in result.findings if finding.severity == "error"]


NEURAL = (BlockKind.ENTROPY_NETWORK, BlockKind.HASH_GRID, BlockKind.PREDICTORS, BlockKind.LAYER)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 30), st.sampled_from(NEURAL), st.integers(0, 2**32 - 1))
def test_damaged_network_blocks_raise_only_our_errors(seed: int, kind: BlockKind, place: int) -> None:
    """A changed byte behind a correct CRC: another valid network, or a refusal; never anything else."""
    data = write_scene(neural_scene(seed, anchors=60))
    blocks = blocks_of(data)
    hit = [number for number, block in enumerate(blocks) if block.kind == kind]
    if not hit:
        return
    number = hit[place % len(hit)]
    payload = bytearray(blocks[number].payload)
    payload[place // 8 % len(payload)] ^= 1 << place % 8
    blocks[number] = replace(blocks[number], payload=bytes(payload))
    try:
        read(rebuilt(data, blocks))
    except ScarError:
        return

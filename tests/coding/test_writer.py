"""Writing: deterministic, complete, and prefixes of layers are files of their own."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from conformance.surgery.files import blocks_of
from fuzz.testing.scenes import random_scene
from fuzz.testing.strategies import quantised_scenes, scenes
from scarfmt.blocks.tables import unpack_tables
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene, keep_layers, write_scene
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockKind, Profile, Stream
from scarfmt.container.source import BytesSource
from scarfmt.scene.model import Channel, LayerRow, SceneModel, first_layers
from scarfmt.tools.truncate import truncate
from tests.samples.codec_samples import refuses
from tests.samples.contents import read_everything
from tests.samples.equality import same
from tests.samples.paged_samples import in_pages


@settings(max_examples=40)
@given(quantised_scenes())
def test_scenes_come_back_and_equal_scenes_give_equal_bytes(scene: QuantisedScene) -> None:
    """Both profiles come back: with tiles without anchors, scenes without anchors, and layers that add nothing."""
    data = write_scene(scene)
    found = read_everything(data)
    assert len(found) == len(scene.contents)
    assert same(found, scene.contents)
    metadata = dict(reversed(list(scene.metadata.items())))
    assert write_scene(replace(scene, contents=tuple(found), metadata=metadata)) == data


@settings(max_examples=25)
@given(scenes(max_layers=6), st.data())
def test_truncating_equals_encoding_fewer_layers(scene: QuantisedScene, data: st.DataObject) -> None:
    """SPEC §14, byte for byte and whatever the pages; in two goes as in one. The scene given is not written to."""
    layers, before = len(scene.model.layers), deepcopy(scene.contents)
    kept, page_bits = data.draw(st.integers(1, layers)), data.draw(st.integers(0, 3))
    via = data.draw(st.integers(kept, layers))
    whole, fewer = (in_pages(write_scene(of), page_bits) for of in (scene, keep_layers(keep_layers(scene, via), kept)))
    assert same(scene.contents, before)
    assert truncate(BytesSource(whole), kept) == fewer
    assert truncate(BytesSource(truncate(BytesSource(whole), via)), kept) == fewer


@pytest.mark.parametrize("profile", Profile)
def test_a_large_single_tile_comes_back(profile: Profile) -> None:
    """Thousands of anchors, where tables of every node size are in use."""
    scene = random_scene(11, profile, anchors=6000, tiles=1, layers=2)
    (found,) = read_everything(write_scene(scene))
    assert same(found, scene.contents[0])


def test_a_layer_that_adds_nothing_has_no_tiles_and_no_tables() -> None:
    """Only its LAYER block, in both profiles unless masks have room to grow."""
    scene = random_scene(4, Profile.EXPLICIT, layers=2)
    scene = replace(scene, model=replace(scene.model, layers=(*scene.model.layers, scene.model.layers[-1])))
    data = write_scene(scene)
    last = [block.kind for block in blocks_of(data) if block.layer == 3]
    assert last == [BlockKind.LAYER]
    assert same(read_everything(data), scene.contents)


def test_tables_are_sent_again_only_when_that_is_cheaper() -> None:
    """A later layer of the same statistics goes on with the tables it has; one of its own statistics does not."""
    rng = np.random.default_rng(5)
    base = random_scene(5, Profile.EXPLICIT, anchors=0, layers=1, tiles=1)
    scale = Channel(Stream.SCALE, (0.5,) * 3)
    model = SceneModel(Profile.EXPLICIT, 1, (scale,), (LayerRow((0,), ((1,),)), LayerRow((0, 0), ((1,), (1,)))))
    content = TileContent.empty(model, 4000)
    content.classes[2000:] = 1
    content.values[0] = rng.choice(5, (4000, 3), p=[0.4, 0.3, 0.15, 0.1, 0.05]).astype(np.int32)
    scales = []
    for shift in (0, 50):
        content.values[0][2000:] += shift
        scene = QuantisedScene(base.fields, model, base.tiles, (content,))
        blocks = {(b.kind, b.layer): b.payload for b in blocks_of(write_scene(scene))}
        later = blocks.get((BlockKind.TABLES, 2))
        sent = unpack_tables(later) if later else {}
        scales.append(sum(key.stream == Stream.SCALE for key in sent))
    assert scales == [0, 3]


def test_models_travel_in_the_layer_that_first_needs_them() -> None:
    """Codebooks and decoder cost a preview nothing."""
    for seed in range(12):
        scene = random_scene(seed, Profile.EXPLICIT, anchors=20, layers=4)
        coarse, residual, decoder = first_layers(scene.model)[:3]
        blocks = {(block.kind, block.layer): block.count for block in blocks_of(write_scene(scene))}
        books = sorted(layer for kind, layer in blocks if kind == BlockKind.CODEBOOKS)
        assert books == sorted({layer for layer in (coarse, residual) if layer is not None})
        assert [layer for kind, layer in blocks if kind == BlockKind.DECODER_MLP] == ([decoder] if decoder else [])


def test_progress_is_reported_from_start_to_end() -> None:
    """Fractions never fall, and end at 1."""
    seen: list[float] = []
    write_scene(random_scene(1, layers=3), lambda _stage, fraction: seen.append(fraction))
    assert seen == sorted(seen)
    assert (seen[0], seen[-1]) == (0.0, 1.0)


def test_scenes_that_do_not_fit_together_are_not_written() -> None:
    """A content too few, a model that takes something back, a metadata value JSON does not know."""
    scene = random_scene(2, layers=2)
    refuses("input-container", lambda: write_scene(replace(scene, contents=scene.contents[:-1])))
    rows = scene.model.layers
    model = replace(scene.model, layers=(*rows, replace(rows[-1], stages=(9,) * rows[-1].class_count)))
    refuses("input-container", lambda: write_scene(replace(scene, model=model)), "bad-layer-table")


@pytest.mark.parametrize("profile", list(Profile))
def test_no_tile_block_is_written_for_nothing(profile: Profile) -> None:
    """R-7.1-7: each has anchors or sub-streams."""
    for seed in range(6):
        container = Container(BytesSource(write_scene(random_scene(seed, profile, anchors=60))))
        tiles = [entry for entry in container.entries if entry.kind == BlockKind.TILE]
        assert tiles
        assert all(entry.count or container.read_block(entry)[0] for entry in tiles)

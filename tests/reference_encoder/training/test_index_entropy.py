"""The index network trained along with a scene: what can be asked for, what it learns, and what its file holds."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from fuzz.testing.scenes import random_scene
from reference_encoder.training.index_entropy import JointIndexModel
from reference_encoder.training.smallest import smallest_file
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.directory import local_bits
from scarfmt.container.schema import Profile
from scarfmt.container.source import BytesSource
from scarfmt.tools.models_report import describe_models


def _placed(scene: QuantisedScene, tile: int) -> TileContent:
    """Indices that follow from where an anchor is, and later ones from the first."""
    content = scene.contents[tile]
    depth = local_bits(scene.fields, scene.tiles[tile])
    region = (content.codes >> np.uint64(max(3 * depth - 3, 0))).astype(np.int64) % 8
    received = scene.model.stages(len(scene.model.layers), content.classes)
    indices = (region[:, None] * (1 + np.arange(scene.model.max_stages))) % 20
    indices = np.where(np.arange(scene.model.max_stages) < received[:, None], indices, 0).astype(np.int16)
    return replace(content, indices=indices)


@pytest.fixture(scope="module")
def scene() -> QuantisedScene:
    """Anchors with two stages or more, whose indices their places decide."""
    for seed in itertools.count(3):
        scene = random_scene(seed, Profile.ANCHOR, anchors=900, tiles=2)
        deep = all(local_bits(scene.fields, tile) >= 6 for tile in scene.tiles)
        if scene.model.max_stages >= 3 and deep:
            return replace(scene, contents=tuple(_placed(scene, tile) for tile in range(2)))
    raise AssertionError


def _assert_comes_back(scene: QuantisedScene, data: bytes) -> None:
    reader = SceneReader(BytesSource(data))
    for tile, content in reader.tiles(reader.models()):
        assert np.array_equal(content.indices, scene.contents[tile].indices)


@pytest.mark.parametrize("paper", [False, True])
def test_the_file_decodes_to_the_same_indices(scene: QuantisedScene, paper: bool) -> None:
    """The network of training is the network of the file: the paper's has attention, two GRU layers, a hybrid grid."""
    joint = JointIndexModel(paper)
    joint.refresh(scene)
    assert (joint.hash_bits > 0) == paper
    for _ in range(5):
        joint.step()
    learned = joint.finish(scene)
    _assert_comes_back(learned, write_scene(learned))
    network, grid = learned.network, learned.grid
    assert (network.attention is not None, len(network.gru), network.inputs.own) == (paper, 1 + paper, not paper)
    seen = describe_models(BytesSource(write_scene(learned)))["index_network"]["inputs"]
    assert (seen["decoded"], seen["grid"] > 0) == (not paper, True)
    assert {level.plane for level in grid.levels} == set(range(7) if paper else (4, 5, 6))


def test_l_feat_falls_while_training_goes_on(scene: QuantisedScene) -> None:
    """Through scenes that are taken again; it is bits an anchor, fewer than plain numbers would take."""
    joint, reports = JointIndexModel(), []
    for number in range(90):
        if number % 30 == 0:
            joint.refresh(scene)
        reports.append(joint.step())
    received = sum(
        int(scene.model.stages(len(scene.model.layers), content.classes).sum()) for content in scene.contents
    )
    assert np.mean(reports[-5:]) < 0.5 * reports[0]
    assert reports[0] < 1.1 * received / 900 * np.log2(20)


def test_what_was_learnt_is_kept_when_codewords_get_other_numbers(scene: QuantisedScene) -> None:
    """A finished training sees the last numbers only, and costs less than a start from nothing would."""
    joint = JointIndexModel()
    joint.refresh(scene)
    first = joint.step()
    for _ in range(40):
        joint.step()
    books = scene.codebooks
    turned = replace(books, coarse=books.coarse[::-1].copy(), residual=books.residual[::-1].copy())
    contents = tuple(replace(content, indices=_turned(scene, content)) for content in scene.contents)
    joint.refresh(replace(scene, codebooks=turned, contents=contents))
    assert joint.step() < 0.8 * first


def _turned(scene: QuantisedScene, content: TileContent) -> np.ndarray:
    received = scene.model.stages(len(scene.model.layers), content.classes)
    there = np.arange(scene.model.max_stages) < received[:, None]
    return np.where(there, 19 - content.indices, 0).astype(np.int16)


def test_the_smaller_file_is_kept_unless_the_paper_is_asked_for(scene: QuantisedScene) -> None:
    """By default a network that does not pay is dropped."""
    noise = replace(scene, contents=tuple(map(_shuffled, scene.contents)))
    for paper in (False, True):
        data = smallest_file(noise, JointIndexModel(paper))
        assert (SceneReader(BytesSource(data)).models().network is not None) == paper


def _shuffled(content: TileContent) -> TileContent:
    """With indices that nothing decides."""
    noise = np.random.default_rng(1).integers(0, 20, content.indices.shape)
    return replace(content, indices=np.where(content.indices > 0, noise, 0).astype(np.int16))


def test_a_scene_without_indices_gets_no_network(scene: QuantisedScene) -> None:
    joint = JointIndexModel()
    assert joint.step() == 0.0
    assert joint.finish(replace(scene, codebooks=None)) is None

"""The index network trained along with a scene: what can be asked for, what it learns, and what its file holds."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import torch

from fuzz.testing.scenes import random_scene
from reference_encoder.decide.assemble import Quantised
from reference_encoder.networks.train import TrainOptions
from reference_encoder.options import EncodeOptions
from reference_encoder.training.index_entropy import IndexOptions, JointIndexModel
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import TileContent, first_values
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.directory import local_bits
from scarfmt.container.schema import Profile, Stream
from scarfmt.container.source import BytesSource
from scarfmt.errors import InvalidInput
from scarfmt.scene.model import ContextRule

SHORT = TrainOptions(epochs=2, batch=128)
ENCODE = EncodeOptions(effort=2, archive=True)
EVERY = [
    ("mlp", "none"),
    ("mlp", "grid3d"),
    ("gru", "decoded"),
    ("gru", "waves"),
    ("gru+attention", "grid2d3d"),
]


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    """Threads only get in each other's way at this size."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def _placed(scene: QuantisedScene, tile: int) -> TileContent:
    """Indices that follow from where an anchor is, and later ones from the first."""
    content = scene.contents[tile]
    depth = local_bits(scene.fields, scene.tiles[tile])
    region = (content.codes >> np.uint64(max(3 * depth - 3, 0))).astype(np.int64) % 8
    received = scene.model.stages(len(scene.model.layers), content.classes)
    indices = (region[:, None] * (1 + np.arange(scene.model.max_stages))) % 20
    indices = np.where(np.arange(scene.model.max_stages) < received[:, None], indices, 0).astype(np.int16)
    made = replace(content, indices=indices)
    made.first = first_values(scene.model, made)
    return made


@pytest.fixture(scope="module")
def scene() -> QuantisedScene:
    """Anchors with two stages or more, whose indices their places decide."""
    for seed in itertools.count():
        scene = random_scene(seed, Profile.ANCHOR, anchors=900, tiles=2)
        deep = all(local_bits(scene.fields, tile) >= 6 for tile in scene.tiles)
        if scene.model.max_stages >= 3 and deep:
            channels = tuple(replace(one, rules=(ContextRule(),) * one.components) for one in scene.model.channels)
            scene = replace(scene, model=replace(scene.model, channels=channels))
            return replace(scene, contents=tuple(_placed(scene, tile) for tile in range(2)))
    raise AssertionError


def _assert_comes_back(scene: QuantisedScene, data: bytes) -> None:
    reader = SceneReader(BytesSource(data))
    for tile, content in reader.tiles(reader.models()):
        assert np.array_equal(content.indices, scene.contents[tile].indices)


@pytest.mark.parametrize(("entropy", "context"), EVERY)
def test_the_file_decodes_to_the_same_indices(scene: QuantisedScene, entropy: str, context: str) -> None:
    """Whatever codes them: the network of training is the network of the file."""
    joint = JointIndexModel(IndexOptions.named(entropy, context))
    joint.refresh(scene)
    for _ in range(5):
        joint.step()
    learned = joint.finish(scene, training=SHORT)
    assert learned is not None
    _assert_comes_back(learned.scene, write_scene(learned.scene))
    network = learned.scene.network
    assert network is not None
    assert (network.attention is not None) == (entropy == "gru+attention")
    assert (learned.scene.grid is not None) == (context not in ("none", "decoded"))
    assert network.inputs.own == (context in ("decoded", "waves"))


def test_l_feat_falls_while_training_goes_on(scene: QuantisedScene) -> None:
    """Through scenes that are taken again; it is bits an anchor, fewer than plain numbers would take."""
    joint, told = JointIndexModel(IndexOptions()), []
    for number in range(90):
        if number % 30 == 0:
            joint.refresh(scene)
        told.append(joint.step())
    received = sum(
        int(scene.model.stages(len(scene.model.layers), content.classes).sum()) for content in scene.contents
    )
    assert np.mean(told[-5:]) < 0.5 * told[0]
    assert told[0] < 1.1 * received / 900 * np.log2(20)


def test_what_was_learnt_is_kept_when_codewords_get_other_numbers(scene: QuantisedScene) -> None:
    """A finished training sees the last numbers only, and costs less than a start from nothing would."""
    joint = JointIndexModel(IndexOptions())
    joint.refresh(scene)
    first = joint.step()
    for _ in range(40):
        joint.step()
    books = scene.codebooks
    assert books is not None
    turned = replace(books, coarse=books.coarse[::-1].copy(), residual=books.residual[::-1].copy())
    contents = tuple(replace(content, indices=_turned(scene, content)) for content in scene.contents)
    joint.refresh(replace(scene, codebooks=turned, contents=contents))
    assert joint.step() < 0.8 * first


def test_a_checkpoint_keeps_what_was_learnt(scene: QuantisedScene) -> None:
    """Grid and all: the first steps after it are no worse than the last before it."""
    joint, again = (JointIndexModel(IndexOptions.named("gru", "grid2d3d")) for _ in range(2))
    joint.refresh(scene)
    told = [joint.step() for _ in range(40)]
    again.restore(joint.state())
    again.refresh(scene)
    assert again.hash_bits == joint.hash_bits
    assert again.step() < 0.5 * (told[0] + told[-1])


def _turned(scene: QuantisedScene, content: TileContent) -> np.ndarray:
    received = scene.model.stages(len(scene.model.layers), content.classes)
    there = np.arange(scene.model.max_stages) < received[:, None]
    return np.where(there, 19 - content.indices, 0).astype(np.int16)


def test_a_perceptron_knows_the_stage_but_no_index_before(scene: QuantisedScene) -> None:
    """The recurrent matrices of a perceptron are zero in the file; a GRU is better where the first index decides the
    others."""
    mlp, gru = (_taught(scene, entropy) for entropy in ("mlp", "gru"))
    network = mlp.network
    assert network is not None
    assert not any(matrix.any() for matrix in network.gru[0].inputs)
    assert not network.gru[0].recurrent.any()
    assert network.gru[0].biases.any()
    assert _index_stream(gru) < 0.8 * _index_stream(mlp)


def _taught(scene: QuantisedScene, entropy: str) -> QuantisedScene:
    """With a network that sees the class alone."""
    training = TrainOptions(epochs=12, batch=64, weight_rate=0.1)
    learned = JointIndexModel(IndexOptions.named(entropy, "none")).finish(scene, training=training)
    assert learned is not None
    return learned.scene


def _index_stream(scene: QuantisedScene) -> int:
    layers = SceneReader(BytesSource(write_scene(scene))).header.layers
    return sum(layer.stream_bytes[Stream.INDICES] for layer in layers)


def test_the_learned_grid_costs_its_bits(scene: QuantisedScene) -> None:
    joint = JointIndexModel(IndexOptions.named("mlp", "grid3d"))
    assert joint.hash_bits == 0.0
    joint.refresh(scene)
    learned = joint.finish(scene, training=SHORT)
    assert learned is not None
    assert learned.scene.grid is not None
    assert joint.hash_bits > 0
    assert {level.plane for level in learned.scene.grid.levels} == {0}


def test_the_smaller_file_is_kept_unless_a_network_was_asked_for(scene: QuantisedScene) -> None:
    """By default a network that does not pay is dropped; one that a user named is not."""
    noise = replace(scene, contents=tuple(map(_shuffled, scene.contents)))
    assert JointIndexModel(IndexOptions()).file(Quantised(noise), ENCODE).scene.network is None
    named = JointIndexModel(IndexOptions.named("gru", None)).file(Quantised(noise), ENCODE)
    assert named.scene.network is not None
    _assert_comes_back(named.scene, named.data)
    static = JointIndexModel(IndexOptions.named("static", None)).file(Quantised(scene), ENCODE)
    assert static.scene.network is None


def _shuffled(content: TileContent) -> TileContent:
    """With indices that nothing decides."""
    noise = np.random.default_rng(1).integers(0, 20, content.indices.shape)
    return replace(content, indices=np.where(content.indices > 0, noise, 0).astype(np.int16))


def test_a_scene_without_indices_gets_no_network(scene: QuantisedScene) -> None:
    joint = JointIndexModel(IndexOptions())
    assert joint.step() == 0.0
    assert joint.finish(replace(scene, codebooks=None)) is None


def test_presets() -> None:
    """The paper's: two GRU layers, attention, the hybrid grid, kept whatever it costs."""
    paper, default = IndexOptions.named(None, None, "paper"), IndexOptions.named(None, None)
    assert (paper.entropy, paper.context, paper.gru_layers, paper.always) == ("gru+attention", "grid2d3d", 2, True)
    assert (default.entropy, default.context, default.always) == ("gru", "waves", False)
    assert IndexOptions.named("static", None, "paper").context == "none"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (IndexOptions("static", "grid3d"), "static tables see no context"),
        (IndexOptions("lstm", "none"), "'lstm' is not one of"),
        (IndexOptions("gru", "sky"), "'sky' is not one of"),
        (IndexOptions("mlp", "none", gru_layers=2), "1 without recurrence"),
        (IndexOptions("gru", "none", gru_layers=5), "5 recurrent layers"),
    ],
)
def test_what_the_format_cannot_say_is_refused(options: IndexOptions, said: str) -> None:
    with pytest.raises(InvalidInput, match=said) as caught:
        JointIndexModel(options)
    assert caught.value.refusal == "input-options"

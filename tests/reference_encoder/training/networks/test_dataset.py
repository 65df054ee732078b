"""Training samples are what the decoder will see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fuzz.testing.scenes import random_scene
from reference_encoder.training.networks.dataset import IndexRows, cluster, index_rows
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.schema import Profile, Stream
from scarfmt.scene.model import DecodedContext

CONTEXT, LATENTS = DecodedContext(2, (16, 2)), 3


def _scene(seed: int, profile: Profile = Profile.EXPLICIT, *, anchors: int) -> QuantisedScene:
    """A random scene with indices and a decoded context: the first from `seed` on."""
    scenes = (random_scene(s, profile, anchors=anchors, layers=4, tiles=2) for s in range(seed, seed + 50))
    scene = next(scene for scene in scenes if scene.codebooks is not None)
    return replace(scene, model=replace(scene.model, context=CONTEXT))


def _rows(scene: QuantisedScene, most: int | None = None) -> IndexRows:
    return index_rows(scene, True, LATENTS, most)


def test_every_index_is_in_exactly_one_row() -> None:
    scene = _scene(5, anchors=300)
    rows = _rows(scene)
    classes = np.concatenate([content.classes for content in scene.contents])
    assert int((rows.after - rows.before).sum()) == rows.symbols
    assert rows.symbols == int(scene.model.stages(len(scene.model.layers), classes).sum())
    assert (rows.before < rows.after).all()


def test_a_sample_is_part_of_the_whole_and_the_same_every_time() -> None:
    scene = _scene(5, anchors=300)
    whole = {tuple(row) for row in _rows(scene).inputs.tolist()}
    part, again = _rows(scene, most=120), _rows(scene, most=120)
    assert {tuple(row) for row in part.inputs.tolist()} <= whole
    assert 60 < len(part) < 200
    np.testing.assert_array_equal(part.inputs, again.inputs)


def test_without_context_only_class_and_attributes_remain() -> None:
    scene = _scene(5, anchors=100)
    scene = replace(scene, model=replace(scene.model, context=DecodedContext()))
    attributes = [c for c in scene.model.channels if c.stream not in (Stream.POSITION_RESIDUAL, Stream.LATENT)]
    width = scene.model.layers[-1].class_count + sum(c.components for c in attributes)
    assert index_rows(scene, True, 0).inputs.shape[1] == width


def test_a_scene_without_anchors_has_no_rows() -> None:
    rows = _rows(_scene(0, anchors=0))
    assert len(rows) == rows.symbols == 0


def _words(count: int, seed: int = 0) -> NDArray[np.int64]:
    words = np.random.default_rng(seed).integers(-99, 100, (count, 5))
    words[count // 2] = 0
    return words


def test_clusters_are_a_permutation_cut_into_pieces_of_like_size() -> None:
    for count in (48, 100, 1024):
        order, sizes = cluster(_words(count), np.arange(count))
        assert sorted(order.tolist()) == list(range(count))
        assert sum(sizes) == count
        assert max(sizes[1:]) - min(sizes[1:]) <= 1
        assert list(sizes) == sorted(sizes)
        assert abs(len(sizes) - np.sqrt(count)) < 3


def test_the_zero_codeword_is_a_cluster_of_its_own() -> None:
    order, sizes = cluster(_words(100), np.ones(100, np.int64))
    assert sizes[0] == 1
    assert not _words(100)[order[0]].any()


def test_like_codewords_share_clusters() -> None:
    """Two clouds far apart are never mixed in one cluster."""
    words = _words(64) // 10
    words[32:] += 1000
    order, sizes = cluster(words, np.ones(64, np.int64))
    assert len(sizes) == 8
    for members in np.split(order, np.cumsum(sizes)[:-1]):
        assert len(set((members >= 32).tolist())) == 1


def test_within_a_cluster_the_most_used_come_first() -> None:
    uses = np.random.default_rng(3).integers(0, 1000, 100)
    order, sizes = cluster(_words(100), uses)
    for members in np.split(order, np.cumsum(sizes)[:-1]):
        assert (np.diff(uses[members]) <= 0).all()


def test_a_small_book_is_coded_flat_in_its_own_order() -> None:
    order, sizes = cluster(_words(20), np.ones(20, np.int64))
    assert sizes == ()
    assert order.tolist() == list(range(20))

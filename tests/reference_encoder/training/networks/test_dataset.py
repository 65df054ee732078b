"""Training samples are what the decoder will see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fuzz.testing.scenes import random_scene
from reference_encoder.training.networks.dataset import IndexRows, index_rows
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

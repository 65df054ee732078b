"""Faults of an encoder are refused when it writes, never only when somebody reads the file."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from fuzz.testing.scenes import random_scene
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.schema import Profile, Stream
from scarfmt.scene.model import Codebooks, SceneModel
from tests.samples import codec_samples


def sample() -> QuantisedScene:
    """An anchor scene with a position residual, several layers, and both codebooks."""
    for seed in range(200):
        scene = random_scene(seed, Profile.ANCHOR, anchors=120, layers=3, tiles=1)
        if scene.model.channels[0].stream == Stream.POSITION_RESIDUAL and scene.model.max_stages > 1:
            return scene
    raise AssertionError


SCENE = sample()
SCALE = 1


def changed(change: Callable[[TileContent, SceneModel], None]) -> QuantisedScene:
    """The scene with its tile changed in place."""
    content = deepcopy(SCENE.contents[0])
    change(content, SCENE.model)
    return replace(SCENE, contents=(content,))


def refuses(scene: QuantisedScene, words: str) -> None:
    codec_samples.refuses("input-container", lambda: write_scene(scene), words)


def set_row(name: str, row: int, value: int) -> Callable[[TileContent, SceneModel], None]:
    def change(content: TileContent, _model: SceneModel) -> None:
        getattr(content, name)[row] = value

    return change


def set_value(channel: int, value: int) -> Callable[[TileContent, SceneModel], None]:
    def change(content: TileContent, model: SceneModel) -> None:
        received = model.steps(len(model.layers), channel, content.classes) > 0
        content.values[channel][received] = value

    return change


def test_the_sample_itself_is_written() -> None:
    """The refusals below are for what was changed."""
    write_scene(changed(lambda _content, _model: None))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (set_row("classes", -1, 15), "class"),
        (set_row("classes", 0, -1), "class"),
        (set_row("codes", -1, 1 << 63), "bits"),
        (set_row("slot_layers", 0, 9), "slot"),
        (set_row("slot_layers", 0, -1), "slot"),
        (set_row("slot_layers", -1, 1), "slot"),
        (set_row("indices", slice(None), 20), "codeword"),
        (set_row("indices", slice(None), -1), "codeword"),
        (set_value(SCALE, -(1 << 31)), "32 bits"),
        (set_value(0, 1 << 20), "residual"),
    ],
    ids=range(10),
)
def test_contents_no_reader_would_accept_are_not_written(
    change: Callable[[TileContent, SceneModel], None], words: str
) -> None:
    """Classes, codes, slots, indices, values: each named."""
    refuses(changed(change), words)


def test_anchors_out_of_order_are_not_written() -> None:
    """The reader would sort positions, and attributes would belong to other anchors."""
    content = SCENE.contents[0]
    refuses(replace(SCENE, contents=(_reordered(content, np.arange(len(content))[::-1]),)), "ordered")


def _reordered(content: TileContent, order: np.ndarray) -> TileContent:
    return TileContent(
        content.codes[order],
        content.classes[order],
        [values[order] for values in content.values],
        content.indices[order],
        content.slot_layers[order],
    )


def network(inputs: int, outputs: int) -> QuantisedMlp:
    return QuantisedMlp((Linear.quantise(np.ones((outputs, inputs)), np.zeros(outputs)),))


def test_models_no_reader_would_accept_are_not_written() -> None:
    """Missing or empty codebooks, codewords out of range, networks that do not fit."""
    books, decoder = SCENE.codebooks, SCENE.decoder
    empty = books.residual[:0]
    wide = books.coarse.copy()
    wide[0, 0] = 1 << 20
    far = books.coarse + (1 << 17)
    refuses(replace(SCENE, codebooks=None), "codebook 0")
    refuses(replace(SCENE, codebooks=Codebooks(books.coarse, empty)), "codebook 1")
    refuses(replace(SCENE, codebooks=Codebooks(wide, books.residual)), "bad-codebook")
    refuses(replace(SCENE, codebooks=Codebooks(far, books.residual)), "bad-codebook")
    refuses(replace(SCENE, decoder=None), "missing-block")
    refuses(replace(SCENE, decoder=network(decoder.inputs + 1, decoder.outputs)), "bad-mlp")
    refuses(replace(SCENE, scene_mlps=SCENE.scene_mlps[:2]), "bad-mlp")
    bad = Linear(np.ones((1, 1), np.int16), np.array([np.inf], np.float32), np.zeros(1, np.float32))
    refuses(replace(SCENE, scene_mlps=(QuantisedMlp((bad,)), *SCENE.scene_mlps[1:])), "bad-mlp")


def test_networks_of_the_anchor_profile_are_not_left_out_in_silence() -> None:
    """A block that the profile has no place for would not be written."""
    refuses(replace(random_scene(3, Profile.EXPLICIT), scene_mlps=SCENE.scene_mlps), "anchor profile")

"""Training samples are what the decoder will see."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fuzz.testing.scenes import random_scene
from reference_encoder.networks.dataset import ContextOptions, IndexRows, index_rows, input_width, lattice_positions
from scarfmt.codecs.channels import coarsen
from scarfmt.codecs.neural_indices import IndexCoder, put_neural_indices
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.directory import local_bits, tile_frame
from scarfmt.container.schema import Profile, Stream
from scarfmt.neural.layer_context import LayerContext, cell_centres
from scarfmt.neural.network import Inputs
from scarfmt.scene.model import DecodedContext, SceneModel

OPTIONS = ContextOptions(passes_log2=2, occupancies=(16, 2), latents=3, latent_shift=1)


def _scene(seed: int, profile: Profile = Profile.EXPLICIT, *, anchors: int, layers: int = 3) -> QuantisedScene:
    """A random scene with indices: the first from `seed` on."""
    scenes = (random_scene(s, profile, anchors=anchors, layers=layers, tiles=2) for s in range(seed, seed + 50))
    return next(scene for scene in scenes if scene.codebooks is not None)


def _rows(scene: QuantisedScene, options: ContextOptions = OPTIONS, most: int | None = None) -> IndexRows:
    assert scene.codebooks is not None
    bits = [local_bits(scene.fields, tile) for tile in scene.tiles]
    return index_rows(scene.model, scene.contents, bits, scene.codebooks, options, most)


@dataclass
class _Recorder:
    """Stands for an evaluator, keeps the inputs it is given and codes nothing."""

    seen: list[NDArray[Any]] = field(default_factory=list)

    def embed(self, x: NDArray[Any], _watch: object = None) -> NDArray[Any]:
        self.seen.append(np.asarray(x))
        return x

    def start(self, count: int) -> int:
        return count

    def take(self, _state: int, rows: NDArray[Any]) -> int:
        return len(rows)

    def advance(self, state: int, _stage: int, _codes: NDArray[Any]) -> int:
        return state

    def mixed(self, h: NDArray[Any], _state: int) -> NDArray[Any]:
        return h

    def first_blocks(self, _book: int, _y: NDArray[Any]) -> list[Any]:
        return []


@dataclass(frozen=True)
class _Head:
    two_level: bool = False


@dataclass(frozen=True)
class _Network:
    inputs: Inputs
    amax: int = 2047
    heads: tuple[_Head, ...] = (_Head(), _Head())


class _Deaf:
    def emit_rows(self, *_: object) -> None: ...


def _decoder_inputs(
    model: SceneModel, scene: QuantisedScene, content: TileContent, tile: int, layer: int
) -> NDArray[np.int64]:
    """Inputs the codec itself gives the network in one tile-layer, pass by pass."""
    attributes = sum(model.channels[k].components for k in model.attributes)
    inputs = Inputs(model.layers[-1].class_count, True, attributes, 2, OPTIONS.latents, OPTIONS.latent_shift, 0)
    recorder = _Recorder()
    coder: Any = IndexCoder(_Network(inputs), scene.codebooks, None, recorder)  # type: ignore[arg-type]
    known = content.classes < model.layers[layer - 1].class_count
    frame = tile_frame(scene.fields, scene.tiles[tile])
    classes = content.classes[known]
    context = LayerContext(model, frame, content.codes[known], classes)
    for index in model.attributes:
        now, final = model.steps(layer, index, classes), model.steps(len(model.layers), index, classes)
        context.settle(index, coarsen(content.values[index][known], (final - now)[:, None]), now)
    stages = model.stages(layer - 1, classes), model.stages(layer, classes)
    put_neural_indices(_Deaf(), coder, context, content.indices[known], *stages)  # type: ignore[arg-type]
    none = np.zeros((0, inputs.width), np.int64)
    return np.concatenate([none, *recorder.seen]).astype(np.int64)


@pytest.mark.parametrize("profile", Profile)
def test_inputs_are_those_of_the_codec(profile: Profile) -> None:
    """Column by column, for every anchor, layer and pass."""
    scene = _scene(11, profile, anchors=400, layers=4)
    model = replace(scene.model, context=DecodedContext(OPTIONS.passes_log2, OPTIONS.occupancies))
    mine = [row.tolist() for row in _rows(replace(scene, model=model)).inputs]
    theirs = [
        row.tolist()
        for tile, content in enumerate(scene.contents)
        for layer in range(1, len(model.layers) + 1)
        for row in _decoder_inputs(model, scene, content, tile, layer)
    ]
    assert len(mine) > 100
    assert sorted(mine) == sorted(theirs)


def test_every_index_is_in_exactly_one_row() -> None:
    scene = _scene(5, anchors=300, layers=4)
    rows = _rows(scene)
    classes = np.concatenate([content.classes for content in scene.contents])
    assert int((rows.after - rows.before).sum()) == rows.symbols
    assert rows.symbols == int(scene.model.stages(len(scene.model.layers), classes).sum())
    assert rows.total == len(rows)
    assert (rows.before < rows.after).all()


def test_a_sample_is_part_of_the_whole_and_the_same_every_time() -> None:
    scene = _scene(5, anchors=300, layers=4)
    whole = {tuple(row) for row in _rows(scene).inputs.tolist()}
    part, again = _rows(scene, most=120), _rows(scene, most=120)
    assert {tuple(row) for row in part.inputs.tolist()} <= whole
    assert part.total == _rows(scene).total
    assert 60 < len(part) < 200
    np.testing.assert_array_equal(part.inputs, again.inputs)


def test_without_context_only_class_and_attributes_remain() -> None:
    scene = _scene(5, anchors=100)
    options = ContextOptions(0, (), latents=0)
    rows = _rows(scene, options)
    attributes = [c for c in scene.model.channels if c.stream not in (Stream.POSITION_RESIDUAL, Stream.LATENT)]
    width = scene.model.layers[-1].class_count + sum(c.components for c in attributes)
    assert rows.inputs.shape[1] == width == input_width(scene.model, options)


def test_a_scene_without_anchors_has_no_rows() -> None:
    scene = _scene(0, anchors=0)
    rows = _rows(scene)
    assert len(rows) == rows.total == rows.symbols == 0


def test_positions_are_those_of_the_hash_grid() -> None:
    """Cell centres, as the codec computes them."""
    scene = _scene(7, anchors=200, layers=3)
    rows = _rows(scene)
    frames = [tile_frame(scene.fields, tile) for tile in scene.tiles]
    found = lattice_positions(rows, scene.contents, frames)
    for place, position in zip(rows.places[:50], found[:50], strict=True):
        content = scene.contents[place[0]]
        np.testing.assert_array_equal(cell_centres(frames[place[0]], content.codes[place[1:]])[0], position)

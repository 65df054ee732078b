"""Random quantised scenes with predictors, an index network and a hash grid, for tests of whole files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.random import Generator

from fuzz.testing.networks import random_network
from fuzz.testing.scenes import random_scene
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.schema import Profile
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.grid import GridLevel, HashGrid
from scarfmt.neural.network import Inputs
from scarfmt.neural.predictors import MAX_INPUTS, Predictor, first_use, input_width
from scarfmt.scene.model import DecodedContext, SceneModel

_OCCUPANCIES = (64, 24, 12, 3, 2, 1)
_MOST_STEPS = 5


def neural_scene(
    seed: int,
    profile: Profile = Profile.EXPLICIT,
    *,
    anchors: int = 200,
    layers: int = 3,
    tiles: int = 3,
    latent: int | None = None,
    network: bool = True,
) -> QuantisedScene:
    """A scene in which predictors and network are as random as its values; about one in four has no grid.

    Args:
        seed, profile, anchors, layers, tiles, latent: as of :func:`fuzz.testing.scenes.random_scene`.
        network: whether it has an index network, if it has codebooks.
    """
    rng = np.random.default_rng([seed, 7])
    scene = random_scene(seed, profile, anchors=anchors, layers=layers, tiles=tiles, latent=latent)
    depths = np.sort(rng.choice(_OCCUPANCIES, int(rng.integers(0, 4)), replace=False))[::-1]
    context = DecodedContext(int(rng.integers(0, 4)), tuple(int(depth) for depth in depths))
    scene = replace(scene, model=replace(scene.model, context=context))
    scene = replace(scene, predictors=_predictors(rng, scene.model))
    return _with_network(rng, scene) if network and scene.codebooks is not None else scene


def _predictors(rng: Generator, model: SceneModel) -> dict[int, tuple[Predictor, ...]]:
    found: dict[int, list[Predictor]] = {}
    for channel in (index for index in model.predicted if input_width(model, index) <= MAX_INPUTS):
        for component in range(model.channels[channel].components):
            for step in range(1, _MOST_STEPS):
                layer = first_use(model, channel, step)
                if layer is not None and rng.random() < 0.5:
                    found.setdefault(layer, []).append(_predictor(rng, model, channel, component, step))
    return {layer: tuple(group) for layer, group in sorted(found.items())}


def _predictor(rng: Generator, model: SceneModel, channel: int, component: int, step: int) -> Predictor:
    width, units = input_width(model, channel), int(rng.integers(0, 4))
    hidden = _linear(rng, units, width, 5) if units else None
    buckets = (int(rng.integers(1, 9)), int(rng.integers(1, 5)))
    return Predictor(
        model.channels[channel].stream, component, step, hidden, _linear(rng, 2, width + units, 7), buckets
    )


def _linear(rng: Generator, rows: int, columns: int, shift: int) -> Linear:
    weights = rng.integers(-20, 21, (rows, columns)).astype(np.int32)
    return Linear(weights, rng.integers(-50, 500, rows), shift)


def _with_network(rng: Generator, scene: QuantisedScene) -> QuantisedScene:
    """From the first layer with a stage on, some layers, that one among them, are of entropy mode 1."""
    assert scene.codebooks is not None
    model = scene.model
    first = next(number for number, row in enumerate(model.layers) if max(row.stages))
    rows = tuple(
        replace(row, neural=number == first or (number > first and bool(rng.random() < 0.7)))
        for number, row in enumerate(model.layers)
    )
    grid = _grid(rng, scene.fields.lattice_bits) if rng.random() < 0.75 else None
    inputs = Inputs(
        int(rng.integers(0, 4)),
        bool(rng.integers(2)),
        sum(model.channels[index].components for index in model.attributes),
        len(model.context.occupancies),
        int(rng.integers(0, scene.codebooks.dimension + 1)),
        int(rng.integers(0, 3)),
        0 if grid is None else grid.width,
    )
    if not inputs.width:
        inputs = replace(inputs, classes=1)
    network = random_network(
        rng,
        scene.codebooks,
        inputs,
        stages=model.max_stages,
        activation_bits=int(rng.integers(8, 13)),
        two_level=bool(rng.integers(2)),
        attention=bool(rng.integers(2)),
        gru_layers=int(rng.integers(1, 3)),
    )
    return replace(scene, model=replace(model, layers=rows), network=network, grid=grid)


def _grid(rng: Generator, lattice_bits: int) -> HashGrid:
    levels = tuple(
        GridLevel(int(rng.integers(0, 4)), int(rng.integers(1, 9)), int(rng.integers(3, 8)), int(rng.integers(1, 3)))
        for _ in range(int(rng.integers(1, 4)))
    )
    bits = tuple(rng.integers(0, 2, (level.entries, level.features)).astype(np.uint8) for level in levels)
    origin = tuple(int(o) for o in rng.integers(0, 1 << min(lattice_bits, 31), 3))
    return HashGrid((origin[0], origin[1], origin[2]), int(rng.integers(0, lattice_bits + 1)), levels, bits)

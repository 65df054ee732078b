"""Random quantised scenes with predictors, an index network and a hash grid, for tests of whole files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.random import Generator

from conformance.scenes.made import Plan
from conformance.scenes.neural_models import GridPlan, NetworkPlan, PredictorPlan
from fuzz.testing.scenes import random_plan, scene_of
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.schema import Profile
from scarfmt.neural.grid import GridLevel
from scarfmt.neural.predictors import MAX_INPUTS, first_use, input_width
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
    plan = random_plan(seed, profile, anchors, layers, tiles, None, latent)
    depths = np.sort(rng.choice(_OCCUPANCIES, int(rng.integers(0, 4)), replace=False))[::-1]
    context = DecodedContext(int(rng.integers(0, 4)), tuple(int(depth) for depth in depths))
    model = SceneModel(plan.profile, plan.slots, plan.channels, plan.rows, context)
    plan = replace(plan, context=context, predictors=tuple(_predictors(rng, model)))
    return scene_of(_with_network(rng, plan, model) if network and model.max_stages else plan)


def _predictors(rng: Generator, model: SceneModel) -> Iterator[PredictorPlan]:
    for index in (index for index in model.predicted if input_width(model, index) <= MAX_INPUTS):
        channel = model.channels[index]
        for component, step in product(range(channel.components), range(1, _MOST_STEPS)):
            if first_use(model, index, step) is not None and rng.random() < 0.5:
                units, classes = (int(n) for n in rng.integers(0, (4, 16)))
                buckets = int(rng.integers(1, 9)), int(rng.integers(1, 5))
                yield PredictorPlan(channel.stream, component, step, units, buckets, classes)


def _with_network(rng: Generator, plan: Plan, model: SceneModel) -> Plan:
    """From the first layer with a stage on, some layers, that one among them, are of entropy mode 1."""
    first = next(number for number, row in enumerate(plan.rows) if max(row.stages))
    rows = tuple(
        replace(row, neural=number == first or (number > first and bool(rng.random() < 0.7)))
        for number, row in enumerate(plan.rows)
    )
    grid = _grid(rng, plan.bits) if rng.random() < 0.75 else None
    network = NetworkPlan(
        int(rng.integers(8, 13)),
        (9, 8, 8),
        min(plan.dimension, 6),
        int(rng.integers(1, 3)),
        int(rng.integers(0, 4)),
        bool(rng.integers(2)),
        int(rng.integers(0, plan.dimension + 1)),
        int(rng.integers(0, 3)),
        attention=bool(rng.integers(2)),
    )
    if not (network.classes or (network.own and model.attributes) or model.context.occupancies or grid):
        network = replace(network, classes=1)
    return replace(plan, rows=rows, network=network, grid=grid)


def _grid(rng: Generator, lattice_bits: int) -> GridPlan:
    levels = tuple(
        GridLevel(int(rng.integers(0, 4)), int(rng.integers(1, 9)), int(rng.integers(3, 8)), int(rng.integers(1, 3)))
        for _ in range(int(rng.integers(1, 4)))
    )
    origin = tuple(int(o) for o in rng.integers(0, 1 << min(lattice_bits, 31), 3))
    return GridPlan((origin[0], origin[1], origin[2]), int(rng.integers(0, lattice_bits + 1)), levels)

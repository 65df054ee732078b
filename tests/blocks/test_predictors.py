"""PREDICTORS block: exact networks through the block, and every record that must be refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.blocks.predictors import pack_predictors, unpack_predictors
from scarfmt.container.schema import Stream
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.predictors import Predictor
from scarfmt.scene.model import MAX_CLASSES
from tests.samples.equality import same


def predictor(seed: int, rest: int = 8, units: int = 3, top: int = 127, classes: int = MAX_CLASSES) -> Predictor:
    rng = np.random.default_rng(seed)

    def layer(rows: int, columns: int) -> Linear:
        weights = rng.integers(-top, top + 1, (rows, columns)).astype(np.int32)
        weights[:, classes:MAX_CLASSES] = 0
        return Linear(weights, rng.integers(-(10**5), 10**5, rows), int(rng.integers(0, 21)))

    inputs = MAX_CLASSES + rest
    hidden = layer(units, inputs) if units else None
    stream = Stream(int(rng.choice([Stream.SCALE, Stream.ROTATION, Stream.OPACITY, Stream.COLOUR])))
    output, buckets = layer(2, inputs + units), (int(rng.integers(1, 17)), int(rng.integers(1, 17)))
    return Predictor(stream, int(rng.integers(0, 64)), int(rng.integers(1, 21)), hidden, output, buckets)


@settings(deadline=None)
@given(
    st.lists(st.integers(0, 2**32 - 1), min_size=1, max_size=4),
    st.integers(1, 40),
    st.integers(0, 9),
    st.sampled_from([1, 127, 128, 300]),
    st.integers(0, MAX_CLASSES),
)
def test_predictors_come_back(seeds: list[int], rest: int, units: int, top: int, classes: int) -> None:
    """Any shape, weights of any size, and whatever classes they look at."""
    made = [predictor(seed, rest, units, top, classes) for seed in seeds]
    found = unpack_predictors(pack_predictors(made))
    assert len(found) == len(made)
    assert same(found, made)


def with_weight(weight: int) -> Predictor:
    """A predictor with this one weight and no biases."""
    made = predictor(1, units=0, top=1)
    weights = 0 * made.output.weights
    weights[0, 0] = weight
    return replace(made, output=Linear(weights, 0 * made.output.biases, 0))


@pytest.mark.parametrize("extreme", [32767, -32767])
def test_the_largest_weights_come_back(extreme: int) -> None:
    """Among zeros."""
    made = with_weight(extreme)
    assert same(unpack_predictors(pack_predictors([made]))[0], made)

"""PREDICTORS block: exact networks through the block, and every record that must be refused."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.blocks.predictors import MAX_PREDICTORS, pack_predictors, unpack_predictors
from scarfmt.container.bytefields import unsigned_varint
from scarfmt.container.schema import Stream
from scarfmt.entropy.rice import pack_rice, pack_shifted
from scarfmt.errors import LimitExceeded, ScarError
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.predictors import Predictor
from scarfmt.scene.model import MAX_CLASSES
from tests.samples.codec_samples import refuses


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


def same(one: Predictor, two: Predictor) -> bool:
    layers = [(one.output, two.output)]
    if one.hidden is not None and two.hidden is not None:
        layers.append((one.hidden, two.hidden))
    equal = all(
        np.array_equal(a.weights, b.weights) and np.array_equal(a.biases, b.biases) and a.shift == b.shift
        for a, b in layers
    )
    return equal and one.key == two.key and one.buckets == two.buckets and one.units == two.units


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
    assert all(same(a, b) for a, b in zip(found, made, strict=True))


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


@pytest.mark.parametrize("weight", [32768, -32768, 1 << 24, 2**31 - 1, -(2**31)])
def test_weights_beyond_32767_are_refused(weight: int) -> None:
    """32768 and its negative even stay within the bound of sums."""
    refuses("bad-predictor", lambda: unpack_predictors(pack_predictors([with_weight(weight)])))


def test_columns_of_unused_classes_cost_nothing() -> None:
    """The weights of used classes, and of all else, are what is coded."""
    made = predictor(2, units=0, classes=4)
    kept = np.delete(made.output.weights, np.s_[4:MAX_CLASSES], axis=1)
    tail = pack_rice(kept.ravel()) + pack_shifted(made.output.biases)
    assert pack_predictors([made])[10:] == tail


def record(**changes: int) -> bytes:
    """One packed predictor with bytes of its head changed."""
    content = bytearray(pack_predictors([predictor(3)]))
    names = ["stream", "component", "step", "one", "two", "classes", "inputs", "units"]
    for name, value in changes.items():
        content[1 + names.index(name)] = value
    return bytes(content)


@pytest.mark.parametrize(
    "changes",
    [
        {"stream": Stream.POSITION_RESIDUAL},
        {"stream": Stream.OFFSETS},
        {"stream": 99},
        {"step": 0},
        {"one": 255, "two": 1},
        {"classes": MAX_CLASSES + 1},
        {"inputs": MAX_CLASSES},
        {"units": 65},
    ],
    ids=str,
)
def test_heads_out_of_range_are_refused(changes: dict[str, int]) -> None:
    """Before anything is allocated from them."""
    refuses("bad-predictor", lambda: unpack_predictors(record(**changes)))


def test_sums_beyond_binary32_are_refused() -> None:
    """The bound of SPEC §10.1, also for weights each of which is allowed."""
    made = predictor(4, rest=40, units=0, top=1000)
    heavy = replace(made, output=Linear(np.full((2, 55), 600, np.int32), np.zeros(2, np.int64), 0))
    refuses("bad-predictor", lambda: unpack_predictors(pack_predictors([heavy])))


def test_too_many_predictors_are_refused() -> None:
    """Counted before they are read."""
    with pytest.raises(LimitExceeded):
        unpack_predictors(unsigned_varint(MAX_PREDICTORS + 1))


def test_an_empty_block_is_refused() -> None:
    """A layer without predictors has none."""
    refuses("bad-predictor", lambda: unpack_predictors(pack_predictors([])))


def test_every_prefix_is_refused() -> None:
    """No byte is spare."""
    whole = pack_predictors([predictor(5), predictor(6, units=0)])
    for end in range(len(whole)):
        refuses("payload-short", partial(unpack_predictors, whole[:end]))
    refuses("payload-long", lambda: unpack_predictors(whole + b"\0"))


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.data())
def test_damaged_blocks_are_refused_or_valid(seed: int, data: st.DataObject) -> None:
    """Nothing but the package's own errors, whatever the bytes; what is accepted keeps its rules."""
    content = bytearray(pack_predictors([predictor(seed, rest=3)]))
    at = data.draw(st.integers(0, len(content) - 1))
    content[at] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(1, len(content)))
    try:
        found = unpack_predictors(bytes(content[:cut]))
    except ScarError:
        return
    for one in found:
        one.check()

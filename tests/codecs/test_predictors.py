"""PREDICTORS block: exact networks through the block, and every record that must be refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from codec_samples import refuses
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.bytefields import compress, decompress, unsigned_varint
from scarfmt.codecs.predictors import MAX_PREDICTORS, pack_predictors, unpack_predictors
from scarfmt.errors import LimitExceeded, ScarError
from scarfmt.model import MAX_CLASSES
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.predictors import Predictor
from scarfmt.schema import Stream


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
    st.lists(st.integers(0, 2**32 - 1), max_size=4),
    st.integers(1, 40),
    st.integers(0, 9),
    st.sampled_from([1, 127, 128, 300]),
    st.integers(0, MAX_CLASSES),
)
def test_predictors_come_back(seeds: list[int], rest: int, units: int, top: int, classes: int) -> None:
    """Any shape, 8-bit and 16-bit weights, and whatever classes they look at."""
    made = [predictor(seed, rest, units, top, classes) for seed in seeds]
    found = unpack_predictors(pack_predictors(made))
    assert len(found) == len(made)
    assert all(same(a, b) for a, b in zip(found, made, strict=True))


@pytest.mark.parametrize("extreme", [127, -127, 128, -128, 1000])
def test_the_extremes_of_both_widths_come_back(extreme: int) -> None:
    """A weight that does not fit a byte makes its record wide."""
    made = predictor(1, units=0, top=1)
    weights = made.output.weights.copy()
    weights[0, 0] = extreme
    made = replace(made, output=replace(made.output, weights=weights))
    assert same(unpack_predictors(pack_predictors([made]))[0], made)


def test_columns_of_unused_classes_cost_nothing() -> None:
    """Eight classes more take eight columns more."""
    sizes = [len(decompress(pack_predictors([predictor(2, classes=c)]), 1 << 16, "")) for c in (4, 12)]
    assert sizes[1] - sizes[0] == 8 * 5


def record(**changes: int) -> bytes:
    """One packed predictor with bytes of its head changed."""
    content = bytearray(decompress(pack_predictors([predictor(3)]), 1 << 16, ""))
    names = ["stream", "component", "step", "one", "two", "classes", "inputs", "units", "width"]
    for name, value in changes.items():
        content[1 + names.index(name)] = value
    return compress(bytes(content))


@pytest.mark.parametrize(
    "changes",
    [
        {"stream": Stream.LATENT},
        {"stream": 99},
        {"step": 0},
        {"one": 255, "two": 1},
        {"classes": MAX_CLASSES + 1},
        {"inputs": MAX_CLASSES},
        {"units": 65},
        {"width": 0},
        {"width": 3},
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
        unpack_predictors(compress(unsigned_varint(MAX_PREDICTORS + 1)))


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.data())
def test_damaged_blocks_are_refused_or_valid(seed: int, data: st.DataObject) -> None:
    """Nothing but the package's own errors, whatever the bytes; what is accepted keeps its rules."""
    content = bytearray(decompress(pack_predictors([predictor(seed, rest=3)]), 1 << 16, ""))
    at = data.draw(st.integers(0, len(content) - 1))
    content[at] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(1, len(content)))
    try:
        found = unpack_predictors(compress(bytes(content[:cut])))
    except ScarError:
        return
    for one in found:
        one.check()

"""Adaptive numbers (SPEC §8.5): exact round trips, few bits where numbers repeat, refusals."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.entropy.numbers import LARGEST, NumberReader, NumberWriter

NUMBERS = st.lists(
    st.tuples(
        st.sampled_from("abc"), st.one_of(st.integers(0, 9), st.integers(0, LARGEST), st.sampled_from([0, LARGEST]))
    ),
    max_size=60,
)


def written(numbers: Iterable[tuple[str, int]]) -> bytes:
    writer = NumberWriter()
    for name, number in numbers:
        writer.number(name, number)
    return writer.finish()


@settings(deadline=None)
@given(NUMBERS)
def test_numbers_come_back(numbers: list[tuple[str, int]]) -> None:
    """Of any size, each with its own model; the stream ends where they do."""
    reader = NumberReader(written(numbers), "x")
    assert [reader.number(name) for name, _ in numbers] == [number for _, number in numbers]
    assert reader.position == len(numbers)
    reader.finish()


def test_models_learn() -> None:
    """A number that always comes costs next to nothing; one of few takes about its entropy."""
    assert len(written([("a", 1)] * 4000)) < 16
    rng = np.random.default_rng(1)
    few = rng.choice(3, 4000, p=[0.7, 0.2, 0.1])
    entropy = -(0.7 * np.log2(0.7) + 0.2 * np.log2(0.2) + 0.1 * np.log2(0.1)) * 4000 / 8
    assert entropy < len(written(("a", int(number)) for number in few)) < 1.05 * entropy

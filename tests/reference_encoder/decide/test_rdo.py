"""Rate-distortion optimised rounding: never further than the next integer, never dearer than plain rounding."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from reference_encoder.decide.rdo import choose_values


def _case(seed: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    draw = np.random.default_rng(seed)
    return draw.laplace(0, 2, (count, 3)), draw.uniform(0, 1, (count, 3)), draw.integers(0, 4, count)


@settings(deadline=None)  # the first one compiles
@given(st.integers(0, 10**6), st.integers(0, 60), st.floats(0, 1))
def test_a_neighbour_of_each_value_in_its_own_place(seed: int, count: int, lambda_: float) -> None:
    """Whatever order classes and components are worked on in; without a price, the nearest."""
    scaled, weight, classes = _case(seed, count)
    chosen = choose_values(scaled, weight, classes, lambda_)
    assert (np.abs(chosen - scaled) <= 1).all()
    assert np.array_equal(choose_values(scaled, weight, classes, 0.0), np.rint(scaled))


def test_classes_and_components_do_not_see_each_other() -> None:
    """Each has a histogram of its own: taken alone it is decided alike."""
    scaled, weight, classes = _case(5, 400)
    chosen = choose_values(scaled, weight, classes, 0.2)
    assert not np.array_equal(chosen, np.rint(scaled))
    for klass in range(4):
        here = classes == klass
        alone = choose_values(scaled[here][:, 1:2], weight[here][:, 1:2], np.zeros(here.sum(), np.int64), 0.2)
        assert np.array_equal(chosen[here][:, 1:2], alone)

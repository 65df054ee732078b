"""Rate-distortion optimised rounding: never further than the next integer, never dearer than plain rounding."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from reference_encoder.rdo.rounding import round_values


def _case(seed: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    draw = np.random.default_rng(seed)
    return draw.laplace(0, 2, (count, 3)), draw.uniform(0, 1, (count, 3)), draw.integers(0, 4, count)


def test_classes_and_components_do_not_see_each_other() -> None:
    """Each has a histogram of its own: taken alone it is decided alike."""
    scaled, weight, classes = _case(5, 400)
    chosen = round_values(scaled, weight, classes, 0.2)
    assert not np.array_equal(chosen, np.rint(scaled))
    units = 2.0 ** np.arange(12).reshape(4, 3)
    of = units[classes]
    assert np.array_equal(round_values(scaled * of, weight / of**2, classes, 0.2, units), chosen)
    for klass in range(4):
        here = classes == klass
        alone = round_values(scaled[here][:, 1:2], weight[here][:, 1:2], np.zeros(here.sum(), np.int64), 0.2)
        assert np.array_equal(chosen[here][:, 1:2], alone)


@given(seed=st.integers(0, 1000), lambda_=st.sampled_from([0.0, 1e-3, 0.1, 10.0]))
def test_rounding_never_raises_the_lagrangian(seed: int, lambda_: float) -> None:
    """Chosen integers are next to the value, are nearest when bits are free, and cost no more in the end."""
    draw = np.random.default_rng(seed)
    scaled = draw.laplace(0, 1, (500, 2))
    weight = draw.random((500, 2)) + 0.1
    chosen = round_values(scaled, weight, draw.integers(0, 3, 500), lambda_)
    assert np.abs(chosen - scaled).max() <= 1
    if lambda_ == 0:
        assert np.array_equal(chosen, np.rint(scaled))
    elif lambda_ == 10.0:
        assert np.abs(chosen).sum() < np.abs(np.rint(scaled)).sum()

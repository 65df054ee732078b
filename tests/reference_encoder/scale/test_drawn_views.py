"""Views that tell much of what Gaussians weigh are drawn more likely, and count as often as they were unlikely."""

from __future__ import annotations

import numpy as np
import pytest

from reference_encoder.scale.drawn_views import drawn_views, told
from scarfmt.render.camera import look_at
from tests.reference_encoder.scale.chain import example


def test_all_views_are_drawn_where_they_may_be_and_count_once() -> None:
    numbers, times = drawn_views(np.array([0.2, 0.0, 0.7, 1e-9]), 3)
    assert numbers.tolist() == [0, 2, 3]
    assert times.tolist() == [1, 1, 1]
    assert len(drawn_views(np.zeros(5), 3)[0]) == 0
    assert len(drawn_views(np.zeros(0), 3)[0]) == 0


@pytest.mark.parametrize("most", [1, 5, 16])
def test_as_many_are_drawn_as_asked_for_and_stand_for_about_all(most: int) -> None:
    shares = np.random.default_rng(0).pareto(1.0, 100)
    numbers, times = drawn_views(shares, most)
    assert len(set(numbers.tolist())) == len(numbers) == most
    assert (times >= 1).all()
    # What a sum over the shares themselves would be, but for the last view drawn.
    assert shares[numbers] @ times == pytest.approx(shares.sum(), rel=1 / most)


def test_a_view_that_tells_nearly_all_stands_for_itself_alone() -> None:
    shares = np.full(50, 1.0)
    shares[20] = 1000.0
    numbers, times = drawn_views(shares, 4)
    assert times[numbers.tolist().index(20)] == 1
    assert np.allclose(times[numbers != 20], 49 / 3)


def test_near_views_tell_more_than_far_ones_and_those_that_look_away_nothing() -> None:
    middle, up = example().positions.mean(axis=0), np.array([0.0, -1.0, 0.0])
    span = float(np.ptp(example().positions, axis=0).max())
    eyes = [middle + np.array([0.0, 0.0, -away * span]) for away in (1, 6)]
    near, far = (look_at(eye, middle, up, 1280, 960) for eye in eyes)
    aside = look_at(eyes[0], eyes[0] + np.array([0.0, 0.0, -1.0]), up, 1280, 960)
    shares = told(example(), [far, near, aside])
    assert shares.sum() == pytest.approx(1)
    assert shares[1] > 3 * shares[0] > 0
    assert shares[2] == 0

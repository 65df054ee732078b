"""The quality that was asked for: corrections that converge, within what is allowed."""

from __future__ import annotations

import math

from hypothesis import assume, given
from hypothesis import strategies as st

from reference_encoder.judge.rate_control import RateControl, next_target
from reference_encoder.tuning import TOLERANCE_DB


@given(asked=st.floats(25, 60), offset=st.floats(-4, 10), slope=st.floats(0.7, 1.8), bend=st.floats(-0.01, 0.01))
def test_corrections_reach_what_was_asked(asked: float, offset: float, slope: float, bend: float) -> None:
    """Whatever the offset and slope of the prediction, a few corrections end within tolerance, if bounds allow it."""

    def gives(aim: float) -> float:
        return asked + offset + slope * (aim - asked) + bend * (aim - asked) ** 2

    # Corrections go 15 dB down and 6 dB up, no further: what lies beyond is not reached.
    assume(gives(asked - 15) <= asked <= gives(asked + 6))
    found = RateControl(asked, 8, asked).converge(asked, lambda aim: aim, gives)
    assert abs(gives(found) - asked) <= TOLERANCE_DB


def test_of_two_misses_the_one_above_is_taken() -> None:
    """PSNR jumps where steps change: 0.3 dB less than asked is worse than 0.5 dB more, and 0.7 dB more is not."""
    for above, taken in ((40.5, 41.0), (40.7, 40.0)):
        found = {40.0: 39.7, 41.0: above}
        search = RateControl(40.0, 1, 40.0)
        assert search.converge(40.0, lambda _: 41.0, found.__getitem__) == taken


def test_no_more_attempts_than_corrections() -> None:
    """Each correction is one more attempt; all are judged, and the closest is taken, be it not the last."""
    attempts: list[float] = []

    def attempt(aim: float) -> float:
        attempts.append(aim)
        return aim

    found = {40.0: 45.0, 35.0: 33.0}
    assert RateControl(40.0, 1, 40.0).converge(attempt(40.0), attempt, lambda aim: found[aim]) == 40.0
    assert attempts == [40.0, 35.0]


def test_what_jumps_is_enclosed() -> None:
    """Between tries on both sides of what is asked, whatever the slope of the last two."""
    assert next_target(40.0, [(40.0, 44.0), (36.0, 38.0)], 40.0) == 36 + 4 * 2 / 6
    assert next_target(40.0, [(40.0, 44.0), (36.0, 38.0), (37.5, 41.0)], 40.0) == 36 + 1.5 * 2 / 3


def test_later_stages_go_on_from_where_earlier_ones_ended() -> None:
    """Corrections that are spared are made later, from the aim that was reached."""
    search = RateControl(40.0, 3, 40.0)
    assert search.converge(40.0, lambda aim: aim, lambda aim: aim + 5, reserve=2) == 35.0
    assert search.converge(35.0, lambda aim: aim, lambda aim: aim + 4) == 36.0
    assert search.left == 1


def test_close_enough_is_left_alone() -> None:
    """Within tolerance, or with pictures without any error, nothing is tried again."""
    assert next_target(41.0, [(41.0, 41.0 + TOLERANCE_DB / 2)], 41.0) is None
    assert next_target(41.0, [(41.0, math.inf)], 41.0) is None

"""The quality that was asked for: corrections that converge, within what is allowed."""

from __future__ import annotations

import math

from hypothesis import assume, given
from hypothesis import strategies as st

from reference_encoder.judge.calibrate import Search, next_aim
from reference_encoder.tuning import TOLERANCE_DB


@given(asked=st.floats(25, 60), offset=st.floats(-4, 10), slope=st.floats(0.7, 1.8), bend=st.floats(-0.01, 0.01))
def test_corrections_reach_what_was_asked(asked: float, offset: float, slope: float, bend: float) -> None:
    """Whatever the offset and slope of the prediction, a few corrections end within tolerance, if bounds allow it."""

    def gives(aim: float) -> float:
        return asked + offset + slope * (aim - asked) + bend * (aim - asked) ** 2

    # Corrections go 15 dB down and 6 dB up, no further: what lies beyond is not reached.
    assume(gives(asked - 15) <= asked <= gives(asked + 6))
    found = Search(asked, 8, asked).settled(asked, lambda aim: aim, gives)
    assert abs(gives(found) - asked) <= TOLERANCE_DB


def test_no_more_attempts_than_corrections() -> None:
    """Each correction is one more attempt, and the one after the last is not judged."""
    attempts: list[float] = []
    judged: list[float] = []

    def attempt(aim: float) -> float:
        attempts.append(aim)
        return aim

    def judge(aim: float) -> float:
        judged.append(aim)
        return aim + 5

    Search(40.0, 1, 40.0).settled(attempt(40.0), attempt, judge)
    assert attempts == [40.0, 35.0]
    assert judged == [40.0]


def test_later_stages_go_on_from_where_earlier_ones_ended() -> None:
    """Corrections that are spared are made later, from the aim that was reached."""
    search = Search(40.0, 3, 40.0)
    assert search.settled(40.0, lambda aim: aim, lambda aim: aim + 5, spare=2) == 35.0
    assert search.settled(35.0, lambda aim: aim, lambda aim: aim + 4) == 36.0
    assert search.left == 1


def test_close_enough_is_left_alone() -> None:
    """Within tolerance, or with pictures without any error, nothing is tried again."""
    assert next_aim(41.0, [(41.0, 41.0 + TOLERANCE_DB / 2)], 41.0) is None
    assert next_aim(41.0, [(41.0, math.inf)], 41.0) is None


def test_an_error_that_stays_buys_only_so_many_bits() -> None:
    """When pictures do not get better, the aim stays within a few dB of what was asked."""
    tried = [(70.0, 60.0)]
    for _ in range(5):
        better = next_aim(70.0, tried, 70.0)
        assert better is not None
        assert better <= 76.0
        tried.append((better, 60.0))

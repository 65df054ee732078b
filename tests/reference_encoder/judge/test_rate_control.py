"""The quality that was asked for: corrections that converge, within what is allowed."""

from __future__ import annotations

import math

from hypothesis import assume, given
from hypothesis import strategies as st

from reference_encoder.judge.rate_control import converge, next_target
from reference_encoder.options import EncodeOptions
from reference_encoder.tuning import (
    FIRST_SLOPE,
    GREATEST_SLOPE,
    MOST_DOWN_DB,
    MOST_UP_DB,
    SURE_DB,
    TOLERANCE_DB,
    WORST_BELOW_DB,
)


def _options(asked: float, corrections: int) -> EncodeOptions:
    return EncodeOptions(quality=asked, corrections=corrections)


@given(asked=st.floats(25, 60), offset=st.floats(-4, 10), slope=st.floats(0.9, 1.3), bend=st.floats(-0.01, 0.01))
def test_corrections_reach_what_was_asked(asked: float, offset: float, slope: float, bend: float) -> None:
    """Whatever the offset of the prediction, a few corrections end close by, if bounds allow it.

    Slopes are about those of real scenes; the last step is not looked at."""

    def gives(aim: float) -> float:
        return asked + offset + slope * (aim - asked) + bend * (aim - asked) ** 2

    # Corrections go 15 dB down and 6 dB up, no further: what lies beyond is not reached.
    assume(gives(asked - 15) <= asked <= gives(asked + 6))
    found = converge(_options(asked, 8), lambda aim: aim, gives)
    assert abs(gives(found) - asked) <= 1


def test_no_more_attempts_than_corrections() -> None:
    """Each correction is one more attempt; far from the target all are judged, and the closest is taken, be it not the
    last."""
    attempts: list[float] = []

    def attempt(aim: float) -> float:
        attempts.append(aim)
        return aim

    assert converge(_options(40.0, 1), attempt, lambda aim: 45.0 if aim == 40 else 33.0) == 40.0
    assert attempts == [40.0, 40 - 5 / FIRST_SLOPE]


def test_nobody_looks_after_a_small_step() -> None:
    """One look is enough near the target; without corrections there is none."""
    looks: list[float] = []

    def look(aim: float) -> float:
        looks.append(aim)
        return aim + SURE_DB

    assert converge(_options(40.0, 3), lambda aim: aim, look) == 40.0 - SURE_DB / FIRST_SLOPE
    assert looks == [40.0]
    assert converge(_options(40.0, 0), lambda aim: aim, look) == 40.0
    assert looks == [40.0]
    converge(EncodeOptions(worst=34.0, corrections=1), lambda aim: aim, look)
    assert looks[1] == 34 + WORST_BELOW_DB
    assert len(looks) == 3, "a percentile jumps: every step is looked at"


def test_what_jumps_is_enclosed() -> None:
    """Between tries on both sides of what is asked, whatever the slope of the last two."""
    assert next_target(40.0, [(40.0, 44.0), (36.0, 38.0)], 40.0) == 36 + 4 * 2 / 6
    assert next_target(40.0, [(40.0, 44.0), (36.0, 38.0), (37.5, 41.0)], 40.0) == 36 + 1.5 * 2 / 3
    assert next_target(40.0, [(40.0, 44.0), (42.0, 38.0)], 40.0) > 42


def test_a_step_is_never_a_leap() -> None:
    """Neither by a slope that two tries seem to have, nor from the first of them."""
    assert next_target(40.0, [(40.0, 50.0), (39.0, 45.0)], 40.0) == 39 - 5 / GREATEST_SLOPE
    assert next_target(40.0, [(40.0, 36.0)] * 2, 40.0) == 40 + 4 / FIRST_SLOPE
    assert next_target(40.0, [(40.0, 99.0)], 40.0) == 40 - MOST_DOWN_DB
    assert next_target(40.0, [(40.0, 1.0)], 40.0) == 40 + MOST_UP_DB


def test_close_enough_is_left_alone() -> None:
    """Within tolerance, or with pictures without any error, nothing is tried again."""
    assert next_target(41.0, [(41.0, 41.0 + TOLERANCE_DB / 2)], 41.0) is None
    assert next_target(41.0, [(41.0, math.inf)], 41.0) is None

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


def test_of_two_misses_the_one_above_is_taken() -> None:
    """PSNR jumps where codebooks change: 0.3 dB less than asked is worse than 0.5 dB more, and 0.7 dB more is not."""
    for above, taken in ((40.5, 41.0), (40.7, 40.0)):
        found = {40.0: 39.7, 41.0: above}
        search = Search(40.0, 1, 40.0)
        assert search.settled(40.0, lambda _: 41.0, found.__getitem__) == taken


def test_no_more_attempts_than_corrections() -> None:
    """Each correction is one more attempt; all are judged, and the closest is taken, be it not the last."""
    attempts: list[float] = []

    def attempt(aim: float) -> float:
        attempts.append(aim)
        return aim

    found = {40.0: 45.0, 35.0: 33.0}
    assert Search(40.0, 1, 40.0).settled(attempt(40.0), attempt, lambda aim: found[aim]) == 40.0
    assert attempts == [40.0, 35.0]


def test_what_jumps_is_enclosed() -> None:
    """Between tries on both sides of what is asked, whatever the slope of the last two."""
    assert next_aim(40.0, [(40.0, 44.0), (36.0, 38.0)], 40.0) == 36 + 4 * 2 / 6
    assert next_aim(40.0, [(40.0, 44.0), (36.0, 38.0), (37.5, 41.0)], 40.0) == 36 + 1.5 * 2 / 3


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


def test_what_is_dear_is_made_again_only_beyond_its_tolerance() -> None:
    """A finished file that is 0.4 dB off stays; one that is 0.6 dB off is made again, once."""
    for off, times in ((0.4, 0), (0.6, 1)):
        search, made = Search(asked=40.0, left=1, start=40.0), []

        def make(aim: float, made: list[float] = made) -> float:
            made.append(aim)
            return aim

        search.settled(40.0 + off, make, lambda found: found, tolerance=0.5)
        assert len(made) == times

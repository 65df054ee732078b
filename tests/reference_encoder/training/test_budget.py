"""The time of a run: it ends in time, with what its end takes, however slow the machine gets."""

from __future__ import annotations

import pytest

from reference_encoder.training import budget
from reference_encoder.training.budget import Budget
from reference_encoder.training.options import TrainOptions


class Clock:
    """Seconds that pass when the test says so."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(budget.time, "monotonic", made)
    return made


def _measure(found: Budget, clock: Clock, **seconds: float) -> None:
    for what, each in seconds.items():
        with found.note(what):
            clock.now += each


def test_what_is_kept_for_the_end_follows_what_coding_and_drawing_take(clock: Clock) -> None:
    """Measured on a machine that becomes busy, more is kept; and the run is over the sooner."""
    found = Budget(TrainOptions(minutes=10), 0.0)
    _measure(found, clock, coding=1.0, picture=0.1)
    found.pictures = 40
    quick = found.estimate_end()
    clock.now = 530.0
    assert found.done(100) < 1
    _measure(found, clock, coding=8.0, picture=1.0)
    assert found.estimate_end() > quick + 20
    assert found.done(101) >= 1
    assert found.plan(101) == 101
    _measure(found, clock, index=0.01)
    before, found.indexed = found.estimate_end(), True
    assert found.estimate_end() > before + 10
    _measure(found, clock, coding=1e4)
    assert found.estimate_end() == 300, "never more than half of the time"
    long = Budget(TrainOptions(minutes=600), 0.0)
    _measure(long, clock, coding=1.0)
    assert long.estimate_end() < 200


def test_a_run_never_goes_back(clock: Clock) -> None:
    """When less needs to be kept than was thought, what has begun stays begun."""
    found = Budget(TrainOptions(minutes=1), 0.0)
    _measure(found, clock, coding=5.0)
    before = found.done(9)
    for _ in range(4):
        _measure(found, clock, coding=0.01)
        assert found.done(10) >= before
        before = found.done(10)


def test_reading_counts_but_one_iteration_is_made(clock: Clock) -> None:
    """Phases are parts of the time that reading leaves."""
    found = Budget(TrainOptions(minutes=1), 20.0)
    clock.now = 4.0
    found.begin()
    clock.now = 5.0
    found.before = 1.0
    assert found.spent == 26
    assert found.done(1) == pytest.approx(2 / (60 - 24 - found.estimate_end()))
    found = Budget(TrainOptions(minutes=1), 70.0)
    assert found.spent == 70
    clock.now = 6.0
    assert found.done(0) == 0
    assert found.done(1) >= 1


def test_predictors_end_before_the_time_does(clock: Clock) -> None:
    """What has to follow them, coding and pictures, still fits."""
    found = Budget(TrainOptions(minutes=1), 30.0)
    _measure(found, clock, coding=2.0)
    assert found.may_train_predictors()
    clock.now = 27.0
    assert not found.may_train_predictors()


def test_looks_take_a_small_part_of_the_time(clock: Clock) -> None:
    """The slower a look, the rarer; at the end as many photos as there is time for."""
    found = Budget(TrainOptions(minutes=10), 0.0)
    found.done(6)
    assert not found.check_due(6, 500)
    clock.now = 100.0
    found.done(7)
    assert found.check_due(7, 500)
    with found.checking():
        clock.now += 6.0
    clock.now += 150.0
    assert not found.check_due(8, 500)
    clock.now += 60.0
    assert found.check_due(9, 500)
    assert found.looks(3, 40) == 40
    _measure(found, clock, picture=1.0)
    assert [found.looks(3, 40), found.looks(3, 5), found.looks(1000, 40)] == [10, 5, 2]


def test_time_decides_nothing_of_a_run_by_iterations(clock: Clock) -> None:
    found = Budget(TrainOptions(iterations=1000), 50.0)
    _measure(found, clock, coding=1e6, picture=1e6)
    assert found.done(500) == 0.5
    assert found.may_train_predictors()
    assert found.looks(4, 30) == 30
    assert [found.check_due(each, 500) for each in (499, 500)] == [False, True]

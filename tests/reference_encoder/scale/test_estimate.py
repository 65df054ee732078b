"""What is left is predicted by what was done."""

from __future__ import annotations

import pytest

from reference_encoder.scale.estimate import TELL_SECONDS, Estimate


class Clock:
    """Goes on when told to."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def made() -> tuple[Estimate, Clock, list[tuple[str, float]], list[str]]:
    clock, reports, lines = Clock(), list[tuple[str, float]](), list[str]()
    shares = {"read": 1.0, "work": 8.0, "write": 1.0}
    estimate = Estimate(shares, lambda said, part: reports.append((said, part)), lines.append, clock)
    return estimate, clock, reports, lines


def test_the_first_tasks_of_a_step_predict_the_rest_and_shares_predict_later_steps() -> None:
    estimate, clock, reports, _ = made()
    estimate.begin("read")
    clock.now = 10
    estimate.end("read", 5)
    assert estimate.later("read") == pytest.approx(90)
    estimate.begin("work")
    clock.now = 20
    estimate.done("work", 1, 19)
    assert reports[-1] == ("work: 19 to do, 3 min left", pytest.approx(20 / (20 + 190 + 10)))


def test_steps_done_earlier_predict_nothing() -> None:
    """Work that is gone on with passes over them in no time."""
    estimate, clock, reports, lines = made()
    estimate.begin("read")
    estimate.end("read", 0)
    assert estimate.later("read") is None
    estimate.begin("work")
    assert reports[-1] == ("work", pytest.approx(0.1))
    clock.now = 16
    estimate.done("work", 0, 4)
    assert reports[-1][0] == "work: 4 to do"
    estimate.end("work", 4)
    assert lines == ["work: 16 s, 2 s left"]


def test_tasks_of_several_kinds_belong_to_one_step() -> None:
    estimate, clock, _, _ = made()
    for now in (4, 10):
        estimate.begin("read")
        clock.now = now
        estimate.end("read", 1)
    assert estimate.later("read") == pytest.approx(90)


def test_a_step_that_another_comes_between_keeps_its_time() -> None:
    """What is fitted is judged, and fitted again."""
    estimate, clock, _, lines = made()
    for step, now in (("read", 4), ("work", 20), ("read", 22)):
        estimate.begin(step)
        clock.now = now
        if step == "work":
            estimate.end(step, 2)
    estimate.end("read", 1)
    assert lines == ["work: 16 s, 2 s left", "read: 2 s, 2 s left"]


def test_parts_never_leave_0_to_1_and_lines_are_few() -> None:
    """A line now and then, not one for each of thousands of tasks."""
    estimate, clock, reports, lines = made()
    for step in ("read", "work", "write"):
        estimate.begin(step)
        for task in range(100):
            clock.now += 1
            estimate.done(step, task + 1, 99 - task)
        estimate.end(step, 100)
    parts = [part for _, part in reports]
    assert 0 <= min(parts) <= max(parts) <= 1
    assert parts[-1] == pytest.approx(1)
    assert len(lines) <= 3 * (100 / TELL_SECONDS + 1)


@pytest.mark.parametrize(("seconds", "said"), [(20, "20 s left"), (600, "10 min left"), (7200, "2.0 h left")])
def test_times_are_told_for_people(seconds: float, said: str) -> None:
    estimate, clock, _, lines = made()
    estimate.begin("read")
    clock.now = seconds / 9
    estimate.end("read", 1)
    assert lines[-1].endswith(said)

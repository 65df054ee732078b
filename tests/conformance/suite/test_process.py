"""A decoder may do what it likes: the vector it was asked about fails, the run goes on, and nothing stays behind."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from scarfmt_conformance.process import Limits, OneShot, Stopped
from scarfmt_conformance.protocol import Question
from scarfmt_conformance.runner import PASSED
from scarfmt_conformance.session import Session

from tests.conformance.suite.conftest import (
    BRIEF_SECONDS,
    MIB,
    ONE_SHOT,
    PATIENCE_SECONDS,
    SESSION,
    SuiteWriter,
    is_gone,
    only,
    score,
    wait_until,
)


def test_a_crash_is_told_with_its_signal(suite: SuiteWriter, ask_by_session: bool) -> None:
    suite.decoded("valid/crash", {"misbehave": "crash"})
    failure = only(score(suite, ask_by_session)).failure
    assert failure is not None
    assert failure.kind == "status"
    assert "SIGSEGV" in failure.message


def test_a_right_answer_with_exit_status_3_fails(suite: SuiteWriter) -> None:
    """A refusal is exit status 0, and so is everything right."""
    suite.refused("invalid/exit", {"misbehave": "exit"})
    failure = only(score(suite)).failure
    assert failure is not None
    assert (failure.kind, failure.message) == ("status", "exit status 3")


def test_silence_fails_at_the_time_limit_and_grandchildren_are_killed(
    suite: SuiteWriter, tmp_path: Path, ask_by_session: bool
) -> None:
    told = tmp_path / "number"
    suite.decoded("valid/hang", {"misbehave": "hang", "told": str(told)})
    failure = only(score(suite, ask_by_session, limits=Limits(BRIEF_SECONDS))).failure
    assert failure is not None
    assert (failure.kind, failure.message) == ("timeout", "no answer within 3 s")
    assert wait_until(lambda: is_gone(int(told.read_text())))


def test_a_child_that_keeps_the_output_open_delays_nothing(suite: SuiteWriter, tmp_path: Path) -> None:
    """The process that was asked has answered and ended with 0: that is right. What it left is killed."""
    told = tmp_path / "number"
    suite.decoded("valid/leaves", {"misbehave": "leave a child", "told": str(told)})
    results = score(suite)
    assert only(results).outcome == PASSED
    assert wait_until(lambda: is_gone(int(told.read_text())))


def test_memory_beyond_the_limit_cannot_be_had(suite: SuiteWriter, ask_by_session: bool) -> None:
    suite.decoded("valid/greedy", {"misbehave": "allocate"})
    failure = only(score(suite, ask_by_session, limits=Limits(PATIENCE_SECONDS, 512 * MIB))).failure
    assert failure is not None
    assert failure.kind == "status"
    assert "MemoryError" in failure.errors


def test_the_memory_limit_leaves_room_below_it(suite: SuiteWriter, ask_by_session: bool) -> None:
    """The peak memory is known if it is more than that of the process that runs this test."""
    suite.decoded("valid/large", {"misbehave": "hold", "mib": 200})
    result = only(score(suite, ask_by_session, limits=Limits(PATIENCE_SECONDS, 512 * MIB)))
    assert result.outcome == PASSED
    if ask_by_session:
        assert result.peak_bytes is not None
    assert result.peak_bytes is None or 200 * MIB < result.peak_bytes < 512 * MIB


def test_memory_that_the_kernel_does_not_refuse_fails_afterwards(suite: SuiteWriter) -> None:
    """Shared pages are no data to the limit, but memory all the same."""
    suite.decoded("valid/shares", {"misbehave": "share", "mib": 150})
    failure = only(score(suite, session=True, limits=Limits(PATIENCE_SECONDS, 128 * MIB))).failure
    assert failure is not None
    assert failure.kind == "memory"
    assert failure.message.endswith("128 MiB are allowed")


def test_a_flood_is_cut_off(suite: SuiteWriter, ask_by_session: bool) -> None:
    suite.decoded("valid/flood", {"misbehave": "print", "text": " " * (3 * MIB)})
    limits = Limits(PATIENCE_SECONDS, output_bytes=2 * MIB)
    failure = only(score(suite, ask_by_session, limits=limits)).failure
    assert failure is not None
    assert failure.kind == "output"


def test_standard_error_is_read_but_harmless(suite: SuiteWriter, ask_by_session: bool) -> None:
    """Megabytes of it neither block a decoder nor fail it; its end is kept, without control characters."""
    suite.decoded("valid/chatty", {"misbehave": "complain"})
    suite.decoded("valid/wrong", {"misbehave": "complain", "answers": {}})
    right, wrong = score(suite, ask_by_session).results
    assert right.outcome == PASSED
    assert wrong.failure is not None
    assert wrong.failure.errors.endswith("the last words")
    assert len(wrong.failure.errors) < 10_000
    assert not {"\x1b", "\x00"} & set(wrong.failure.errors)


def test_giving_up_ends_a_decoder_at_once(suite: SuiteWriter, tmp_path: Path, ask_by_session: bool) -> None:
    told = tmp_path / "number"
    file = suite.decoded("valid/hang", {"misbehave": "hang", "told": str(told)}) / "input.scar"
    stop = threading.Event()
    limits = Limits(300.0)
    decoder = Session(SESSION, limits, stop) if ask_by_session else OneShot(ONE_SHOT, limits, stop)

    def stop_when_it_hangs() -> None:
        wait_until(lambda: told.exists() and bool(told.read_text()))
        stop.set()

    helper = threading.Thread(target=stop_when_it_hangs)
    helper.start()
    with pytest.raises(Stopped):
        decoder.ask(Question(file, 1, "all"))
    decoder.close()
    helper.join()
    assert wait_until(lambda: is_gone(int(told.read_text())))

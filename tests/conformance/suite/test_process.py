"""A decoder may do what it likes: the vector it was asked about fails, the run goes on, and nothing stays behind."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest
from scarfmt_conformance.process import Limits, Program
from scarfmt_conformance.protocol import Fault, Question, Refusal
from scarfmt_conformance.runner import FAILED, PASSED

from tests.conformance.suite.conftest import (
    BRIEF_SECONDS,
    MIB,
    PATIENCE_SECONDS,
    SuiteWriter,
    is_gone,
    only,
    program,
    score,
    wait_until,
)


@pytest.mark.parametrize(
    ("misbehaviour", "kind", "said"),
    [("crash", "status", "SIGSEGV"), ("hang", "timeout", "no answer within 3 s"), ("allocate", "status", "status 1")],
)
def test_a_vector_fails_with_what_its_decoder_did_and_the_others_are_asked(
    suite: SuiteWriter, tmp_path: Path, ask_by_session: bool, misbehaviour: str, kind: str, said: str
) -> None:
    """A session is started again; what a decoder started is killed with it."""
    told = tmp_path / "number"
    suite.decoded("valid/before")
    suite.decoded("valid/bad", {"misbehave": misbehaviour, "told": str(told)})
    suite.decoded("valid/after")
    before, bad, after = score(suite, ask_by_session, limits=Limits(BRIEF_SECONDS, 512 * MIB)).results
    assert (before.outcome, bad.outcome, after.outcome) == (PASSED, FAILED, PASSED)
    assert bad.failure is not None
    assert (bad.failure.kind, said in bad.failure.message) == (kind, True)
    assert not told.exists() or wait_until(lambda: is_gone(int(told.read_text())))


def test_a_right_answer_with_exit_status_3_fails(suite: SuiteWriter) -> None:
    """A refusal is exit status 0, and so is everything right."""
    suite.refused("invalid/exit", {"misbehave": "exit"})
    failure = only(score(suite)).failure
    assert failure is not None
    assert (failure.kind, failure.message) == ("status", "exit status 3")


def test_a_child_that_keeps_the_output_open_delays_nothing(suite: SuiteWriter, tmp_path: Path) -> None:
    """The process that was asked has answered and ended with 0: that is right. What it left is killed."""
    told = tmp_path / "number"
    suite.decoded("valid/leaves", {"misbehave": "leave a child", "told": str(told)})
    assert only(score(suite)).outcome == PASSED
    assert wait_until(lambda: is_gone(int(told.read_text())))


def test_a_flood_is_cut_off(suite: SuiteWriter, ask_by_session: bool) -> None:
    suite.decoded("valid/flood", {"misbehave": "print", "text": " " * (3 * MIB)})
    failure = only(score(suite, ask_by_session, limits=Limits(PATIENCE_SECONDS, output_bytes=2 * MIB))).failure
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


def test_a_killed_decoder_ends_at_once_and_is_not_started_again(
    suite: SuiteWriter, tmp_path: Path, ask_by_session: bool
) -> None:
    told = tmp_path / "number"
    file = suite.decoded("valid/hang", {"misbehave": "hang", "told": str(told)}) / "input.scar"
    decoder = program(ask_by_session, Limits(300.0))

    def kill_it_when_it_hangs() -> None:
        wait_until(lambda: told.exists() and bool(told.read_text()))
        decoder.kill()

    helper = threading.Thread(target=kill_it_when_it_hangs)
    helper.start()
    assert isinstance(decoder.ask(Question(file, 1, "all")).answer, Fault)
    helper.join()
    assert wait_until(lambda: is_gone(int(told.read_text())))
    assert decoder.ask(Question(file, 1, "all")).answer == Fault("status", "the run is given up")


# ------------------------------------------------------------------------------------------------ sessions


def session(script: str, seconds: float = PATIENCE_SECONDS) -> Program:
    return Program(["/bin/sh", "-c", script], Limits(seconds), session=True)


ANY = Question(Path("any"), 0, "all")


def test_a_session_answers_in_one_process_and_one_that_stays_is_killed() -> None:
    """One that ignores the end of its input does not delay the end of a run."""
    decoder = session('while read line; do echo "{\\"refused\\": \\"x-$$\\"}"; done; exec sleep 300')
    first, second = (decoder.ask(ANY).answer for _ in range(2))
    decoder.close()
    assert isinstance(first, Refusal)
    assert first == second
    assert is_gone(int(first.id.removeprefix("x-")))


def test_a_second_line_fails_the_question() -> None:
    """Else it would answer the next."""
    answer = session("read line; printf '{\"refused\": \"first\"}\\n{}\\n'; read line").ask(ANY).answer
    assert answer == Fault("answer", "printed more than one line")


def test_a_second_line_that_comes_late_answers_no_question() -> None:
    line = "echo '{\"refused\": \"first\"}'"
    decoder = session(f"read line; {line}; sleep 0.2; {line}; read line")
    assert decoder.ask(ANY).answer == Refusal("first", "")
    time.sleep(1)
    late = decoder.ask(ANY).answer
    decoder.close()
    assert isinstance(late, Fault)
    assert "more than one line" in late.message


def test_a_session_may_end_after_an_answer_and_is_started_again() -> None:
    decoder = session("read line; echo '{\"refused\": \"x-y\"}'")
    for _ in range(2):
        assert decoder.ask(ANY).answer == Refusal("x-y", "")
        time.sleep(1)


def test_a_session_that_ends_without_an_answer_fails_the_question() -> None:
    assert session("read line; exit 4").ask(ANY).answer == Fault("status", "ended without an answer (exit status 4)")

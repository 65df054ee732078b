"""One process for many questions: started again when it has to be, and the right vector blamed."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from scarfmt_conformance.process import Limits
from scarfmt_conformance.protocol import Fault, Question, Refusal
from scarfmt_conformance.runner import FAILED, PASSED
from scarfmt_conformance.session import Session

from tests.conformance.suite.conftest import (
    BRIEF_SECONDS,
    MIB,
    PATIENCE_SECONDS,
    SESSION,
    SuiteWriter,
    is_gone,
    score,
    wait_until,
)


@pytest.mark.parametrize("misbehaviour", ["crash", "exit", "hang", "allocate"])
def test_a_session_is_started_again_and_the_right_vector_blamed(
    suite: SuiteWriter, tmp_path: Path, misbehaviour: str
) -> None:
    suite.decoded("valid/before")
    suite.decoded("valid/bad", {"misbehave": misbehaviour, "told": str(tmp_path / "number")})
    suite.decoded("valid/after")
    suite.decoded("valid/later")
    results = score(suite, session=True, limits=Limits(BRIEF_SECONDS, 512 * MIB))
    outcomes = {result.vector.id: result.outcome for result in results.results}
    assert outcomes.pop("valid/bad") == FAILED
    assert set(outcomes.values()) == {PASSED}
    assert results.restarts == 1


def test_a_session_answers_many_questions_in_one_process(suite: SuiteWriter) -> None:
    folder = suite.refused("invalid/one")
    session = Session(SESSION, Limits(PATIENCE_SECONDS), threading.Event())
    question = Question(folder / "input.scar", 0, "all")
    answers = [session.ask(question).answer for _ in range(5)]
    session.close()
    assert answers == [Refusal("bad-table", "no (byte 7)", 7)] * 5
    assert session.restarts == 0


def test_output_between_questions_answers_none(suite: SuiteWriter, tmp_path: Path) -> None:
    """A late second line is thrown away with the process that printed it."""
    script = tmp_path / "late.py"
    script.write_text(
        "import sys, time\n"
        "for line in sys.stdin:\n"
        '    print(\'{"refused": "first"}\', flush=True)\n'
        "    time.sleep(0.2)\n"
        '    print(\'{"refused": "late"}\', flush=True)\n'
    )
    session = Session([SESSION[0], "-I", "-S", str(script)], Limits(PATIENCE_SECONDS), threading.Event())
    question = Question(tmp_path / "any", 0, "all")
    assert session.ask(question).answer == Refusal("first", "")
    child = session._child
    assert child is not None
    assert wait_until(lambda: child.turn(0.1) or child.has_line)
    reply = session.ask(question)
    assert reply.answer == Refusal("first", "")
    assert reply.before == Fault("answer", "printed more than one line")
    session.close()
    assert session.restarts == 1


def test_a_session_that_reads_nothing_is_stopped(tmp_path: Path) -> None:
    session = Session(["/bin/sh", "-c", "exec sleep 300"], Limits(0.3), threading.Event())
    answer = session.ask(Question(tmp_path / "any", 0, "all")).answer
    assert isinstance(answer, Fault)
    assert answer.kind == "timeout"
    session.close()


def test_closing_waits_for_no_session_that_stays(tmp_path: Path) -> None:
    """One that ignores the end of its input is killed."""
    script = 'while read line; do echo \'{"refused": "x-y"}\'; done; exec sleep 300'
    session = Session(["/bin/sh", "-c", script], Limits(PATIENCE_SECONDS), threading.Event())
    assert session.ask(Question(tmp_path / "any", 0, "all")).answer == Refusal("x-y", "")
    child = session._child
    assert child is not None
    session.close()
    assert is_gone(child.number)


def test_two_lines_fail_a_session(suite: SuiteWriter) -> None:
    """Else the second would answer the next question."""
    line = '{"refused": "bad-table"}\n'
    suite.refused("invalid/twice", {"misbehave": "print", "text": line + line})
    suite.refused("invalid/after")
    results = score(suite, session=True)
    assert [result.outcome for result in results.results] == [FAILED, PASSED]
    failure = results.results[0].failure
    assert failure is not None
    assert failure.message == "printed more than one line"

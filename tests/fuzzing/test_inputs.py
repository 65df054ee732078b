"""Mutants and inputs of campaigns: reproducible, of the kind asked for, and deep enough to reach every check."""

from __future__ import annotations

import os
import time
from collections import Counter
from pathlib import Path

import pytest

from fuzz.campaign import Examiner, run_campaign
from fuzz.case import Case
from fuzz.corpus import encode_random
from fuzz.inputs import Inputs, examine
from fuzz.target import decode_all, decode_by
from fuzz.testing.mutators import ON_BLOCKS

FILES = encode_random()
SMALL = [file.data for file in FILES if len(file.data) < 8000]


def test_deep_mutants_get_past_checksums_and_often_past_the_structure() -> None:
    """Deep mutants change the contents of files; plain mutants end at a checksum in half of the cases."""
    found = [Inputs(FILES, 3, "deep")(number) for number in range(300)]
    refusals = Counter(decode_all(one.mutant.data) for one in found)
    assert {operator for one in found for operator in one.mutant.operators} == set(ON_BLOCKS)
    assert not [refusal for refusal in refusals if "crc" in refusal]
    assert refusals[""] > 15
    assert len(refusals) > 15


def test_engines_that_answer_differently_are_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other values or another refusal."""
    make = Inputs(FILES, 5, "deep")
    assert {examine(make(number), False, True)[1] for number in range(30)} == {None}
    monkeypatch.setattr("fuzz.inputs.decode_by", lambda _, native: str(native))
    assert examine(make(0), False, True)[1] == "the engines differ"


def test_an_input_that_ends_the_process_is_a_finding_and_the_others_are_examined(tmp_path: Path) -> None:
    """So is one that raises; bytes are kept of both."""

    def act(number: int) -> tuple[str, None]:
        if number == 3:
            os._exit(9)
        if number == 6:
            raise ValueError("six")
        return "fine", None

    def make(number: int) -> Case:
        return Case(f"{number} it", bytes([number]), lambda: act(number))

    tally = run_campaign(Examiner(make, findings=tmp_path), range(8), 2, time.monotonic() + 600)
    assert tally.outcomes == {"fine": 3, "ValueError": 1}, "those after it"
    assert [finding["input"] for finding in tally.findings] == ["3 it", "6 it"]
    assert tally.findings[0]["what"].startswith("died, exit code 9")
    assert ((tmp_path / "3").read_bytes(), (tmp_path / "6").read_bytes()) == (b"\3", b"\6")


@pytest.mark.parametrize("native", [False, True])
def test_an_engine_answers_with_values_or_a_refusal(native: bool) -> None:
    """Equal values have equal digests, other values others."""
    by_name = {file.name: file.data for file in FILES}
    answers = [decode_by(by_name[f"neural-explicit-{seed}"], native) for seed in (3, 4)]
    assert answers[0] != answers[1]
    assert decode_by(by_name["neural-explicit-4"], not native) == answers[1]
    assert decode_by(by_name["scene-explicit-4"][:100], native) == "truncated-header"

"""Inputs of campaigns: reproducible, of the kind that is asked for, and a difference between engines is a finding."""

from __future__ import annotations

from collections import Counter
from multiprocessing import Value

import pytest

from fuzz import campaign
from fuzz.campaign import Rules, Runner
from fuzz.corpus import encoded
from fuzz.inputs import DEEP, KINDS, BitFlips, DeepMutants
from fuzz.target import decoded, decoded_by

FILES = encoded()


@pytest.mark.parametrize("kind", KINDS)
def test_an_input_is_the_same_file_for_the_same_seed_and_number(kind: str) -> None:
    first, again, other = (KINDS[kind](FILES, seed) for seed in (1, 1, 2))
    assert [first(n).mutant for n in range(20)] == [again(n).mutant for n in range(20)]
    assert [first(n).mutant for n in range(20)] != [other(n).mutant for n in range(20)]


def test_deep_mutants_get_past_checksums_and_often_past_the_structure() -> None:
    """Deep mutants change the contents of files; plain mutants end at a checksum in half of the cases."""
    inputs = [DeepMutants(FILES, 3)(number) for number in range(300)]
    refusals = Counter(decoded(one.mutant.data) for one in inputs)
    assert {operator for one in inputs for operator in one.mutant.operators} == set(DEEP)
    assert not [refusal for refusal in refusals if "crc" in refusal]
    assert refusals[""] > 15
    assert len(refusals) > 15


def test_a_flipped_bit_is_one_bit() -> None:
    by_name = {file.name: file.data for file in FILES}
    flips = [one for one in (BitFlips(FILES, 1)(number) for number in range(50)) if one.mutant.operators == ("bit",)]
    assert len(flips) > 40
    for one in flips:
        before = by_name[one.file]
        changed = int.from_bytes(before) ^ int.from_bytes(one.mutant.data)
        assert changed.bit_count() == 1


def test_engines_that_answer_differently_are_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other values or another refusal; equal answers are counted only."""
    monkeypatch.setattr(campaign, "save", lambda one: None)
    make = DeepMutants(FILES, 5)
    numbers = list(range(30))
    found = Runner(make, Rules(compare=True)).run(iter(numbers), Value("q", -1, lock=False))
    assert found.findings == []
    assert found.outcomes["engines compared"] == len(numbers)
    monkeypatch.setattr(campaign, "decoded_by", lambda data, engine: engine)
    found = Runner(make, Rules(compare=True)).run(iter(numbers), Value("q", -1, lock=False))
    assert [finding["what"] for finding in found.findings] == ["engines differ"] * len(numbers)


def test_an_engine_answers_with_values_or_a_refusal() -> None:
    """Equal values have equal digests, other values others."""
    by_name = {file.name: file.data for file in FILES}
    answers = [decoded_by(by_name[f"neural-explicit-{seed}"], "numpy") for seed in (3, 4)]
    assert answers[0] != answers[1]
    assert decoded_by(by_name["scene-explicit-4"], "auto") == answers[1]
    assert decoded_by(by_name["scene-explicit-4"][:100], "numpy") == "truncated-header"

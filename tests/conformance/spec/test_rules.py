"""Every rule and refusal id of SPEC.md has a vector or a test, and ``rules.json`` says which."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from conformance.expect.json_text import json_text
from conformance.spec import rules as coverage_of
from conformance.spec.rules import RULES, Vector, coverage, faults, unruled, vectors
from conformance.spec.spec_text import refusal_classes, rules, text

KNOWN = vectors()
UNLIKELY = Vector("invalid/unlikely", frozenset({"R-5.2-5"}), frozenset({"bad-reserved"}), "refused")


def test_every_rule_and_refusal_id_is_covered() -> None:
    """No rule without vector or test, no refusal of a rule without a vector, nothing named that is not there."""
    assert faults(KNOWN) == []


def test_rules_json_is_what_the_generator_makes() -> None:
    assert RULES.read_text() == json_text(coverage(KNOWN)), "run python -m conformance.spec.rules --write"


def test_rules_json_names_every_rule_once_with_its_vectors() -> None:
    """The file alone answers which vectors are of a rule."""
    found = json.loads(RULES.read_text())
    assert list(found["rules"]) == list(rules())
    assert set(found["refusals"]) == set(refusal_classes())
    ids = {vector.id for vector in KNOWN}
    assert all(set(row["vectors"]) <= ids for table in ("rules", "refusals") for row in found[table].values())
    assert all(row["vectors"] or row["tests"] for table in ("rules", "refusals") for row in found[table].values())
    assert found["rules"]["R-5.2-5"]["refusals"] == ["bad-reserved"]
    assert not found["rules"]["R-5.3-9"]["checked"]


def test_every_rule_of_a_file_that_prints_an_id_has_a_vector() -> None:
    """Tests are no excuse for these, but for a reader of incomplete files, an editor, and who lacks the memory.

    A scene index is no file.
    """
    named = {rule for vector in KNOWN for rule in vector.rules}
    of_files = [rule for rule in rules().values() if not rule.id.startswith("R-17-")]
    memory = {"limit-gathered"}
    assert [rule.id for rule in of_files if set(rule.refusals) - memory and rule.id not in named] == []
    given = {refusal for vector in KNOWN for refusal in vector.refusals}
    of_indices = {id_ for rule in rules().values() for id_ in rule.refusals if rule not in of_files}
    assert set(refusal_classes()) - of_indices - given == memory
    assert of_indices == {"limit-scene", "bad-scene", "unsupported-scene", "scene-file"}


@pytest.mark.parametrize(
    ("vector", "words"),
    [
        (replace(UNLIKELY, rules=frozenset({"R-99.1-1"})), "SPEC.md lacks"),
        (replace(UNLIKELY, refusals=frozenset({"bad-weather"})), "SPEC.md lacks"),
        (replace(UNLIKELY, refusals=frozenset({"bad-zstd"})), "none of its rules prints"),
        (replace(UNLIKELY, rules=frozenset(), refusals=frozenset(), result="decoded"), "names no rule"),
    ],
)
def test_a_wrong_vector_is_told(vector: Vector, words: str) -> None:
    assert any(vector.id in line and words in line for line in faults([*KNOWN, vector]))


def test_a_rule_that_loses_its_only_vectors_is_told() -> None:
    rest = [vector for vector in KNOWN if "R-5.5-4" not in vector.rules]
    assert {"R-5.5-4 has neither vector nor test", "R-5.5-4 has no vector refused as tile-shift"} <= set(faults(rest))


def test_a_test_that_is_gone_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    gone = "tests/conformance/spec/test_spec.py::test_of_nothing"
    monkeypatch.setattr(coverage_of, "rule_tests", lambda: {"R-2-1": [gone]})
    assert f"no test {gone}" in faults(KNOWN)


def test_a_must_outside_the_rules_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody may be obliged by a sentence that no vector can name."""
    assert unruled() == []
    monkeypatch.setattr(coverage_of, "text", lambda: text() + "\n\nA reader MUST whistle.\n")
    assert unruled() == ["A reader MUST whistle."]

"""Every rule and refusal id of SPEC.md and SPEC-neural.md has a vector or a test, and ``rules.json`` says which."""

from __future__ import annotations

import re

from conformance.expect.json_text import json_text
from conformance.spec.rules import RULES, coverage, faults, vectors
from conformance.spec.spec_text import RULE_ID, checks, find_rules, refusal_classes, rules, text

KNOWN = vectors()


def test_every_rule_and_refusal_id_is_covered() -> None:
    """No rule without vector or test, no refusal of a rule without a vector, nothing named that is not there."""
    assert faults(KNOWN) == []


def test_rules_json_is_what_the_generator_makes() -> None:
    assert RULES.read_text() == json_text(coverage(KNOWN), levels=2), "run python -m conformance.spec.rules --write"


def test_every_rule_of_a_file_that_prints_an_id_has_a_vector() -> None:
    """A test is enough only for a reader that lacks the memory."""
    named, given = ({x for v in KNOWN for x in getattr(v, field)} for field in ("rules", "refusals"))
    memory = {"limit-gathered"}
    assert [rule.id for rule in rules().values() if set(rule.refusals) - memory and rule.id not in named] == []
    assert set(refusal_classes()) - given == memory


def test_every_rule_is_defined_once_and_every_rule_cited_exists() -> None:
    """A withdrawn rule is named by its withdrawal only."""
    listed = [rule for rule, _ in find_rules(text())]
    assert len(listed) == len(set(listed))
    withdrawn = set(re.findall(r"Withdrawn[^:]*:(.*?)\n\n", text(), re.DOTALL))
    cited = set(RULE_ID.findall(text()))
    assert cited - set(rules()) <= {rule for words in withdrawn for rule in RULE_ID.findall(words)}


def test_a_check_and_its_rule_name_the_same_ids() -> None:
    """Where a rule stands in a list, too."""
    for rule, lines in checks(text()).items():
        assert {id_ for _, ids in lines for id_ in ids} <= set(rules()[rule].refusals), rule

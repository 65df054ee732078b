"""SPEC §12.2 against the rules: the lists of both texts name every check, with the ids that its rules print."""

from __future__ import annotations

import re

from conformance.spec.spec_text import RULE_ID, rules, text

_ROW = re.compile(r"^\| (\d+)\.(\d+) \| (.+?) \| (R-.*?) \| (.*?) \|$", re.MULTILINE)
_RANGE = re.compile(rf"({RULE_ID.pattern})(?: to ({RULE_ID.pattern}))?")
_PAYLOAD = {"bad-varint", "payload-short", "payload-long"}
_NUMBER = {"rans-length", "rans-last-word", "limit-expansion", "bad-number", "count-limit", "rans-seal"}
_OF_NUMBERS = ["R-8.2-1", "R-13.2-1", "R-8.5-1", "R-8.5-2", "R-8.5-4", "R-8.2-2"]
# Not of a decode of a whole file: annotations, later versions, truncation.
_ELSEWHERE = ("R-7.10-", "R-7.13-", "R-11-", "R-14-")


def lines() -> list[tuple[int, int, list[str], set[str]]]:
    """(list, line, rules, ids) of every line of the lists 4 to 8."""
    out = []
    for list_, line, _, cited, else_ in _ROW.findall(text()):
        ids = set(re.findall(r"`([a-z-]+)`", else_)) | (_PAYLOAD if "payload ids" in else_ else set())
        found = RULE_ID.findall(cited)
        if "number ids" in else_:
            ids, found = ids | _NUMBER, found + _OF_NUMBERS
        out.append((int(list_), int(line), found, ids))
    return out


def rules_of_the_front() -> set[str]:
    """Those of the lists 1 to 3, which name rules from one to another."""
    start = text().index("**List 1: ")
    out = set()
    for first, last in _RANGE.findall(text()[start : text().index("**List 4: ")]):
        section, number = first.rsplit("-", 1)
        out |= {f"{section}-{n}" for n in range(int(number), int((last or first).rsplit("-", 1)[1]) + 1)}
    return out


def test_a_line_names_ids_that_its_rules_print() -> None:
    for list_, line, cited, ids in lines():
        printed = {id_ for rule in cited for id_ in rules()[rule].refusals}
        assert ids - _PAYLOAD <= printed, (list_, line)
        assert ids & (printed | _PAYLOAD), (list_, line)


def test_every_rule_with_an_id_is_in_a_line_with_each_of_them() -> None:
    """A reader of a file cut short, who refuses blocks beyond, is no decoder of a whole file."""
    listed = {(rule, id_) for _, _, cited, ids in lines() for rule in cited for id_ in ids}
    apart = rules_of_the_front() | {rule for rule in rules() if rule.startswith("R-5.7-")}
    of_a_decode = [rule for rule in rules().values() if rule.checked and not rule.id.startswith(_ELSEWHERE)]
    wanted = {(rule.id, id_) for rule in of_a_decode for id_ in rule.refusals}
    missing = {pair for pair in wanted - listed if pair[0] not in apart}
    # In a TILE block R-7.1-3 comes first.
    assert missing <= {("R-8.2-1", "rans-length")}

"""SPEC.md §12.2 against the rules: the lists name every check once, with the ids that its rules print."""

from __future__ import annotations

import re

import pytest

from conformance.spec.spec_text import RULE_ID, Rule, rules, text

_ROW = re.compile(r"^\| (\d+)\.(\d+) \| (.+?) \| (.*?) \| (.*?) \|$", re.MULTILINE)
_PAYLOAD = {"bad-varint", "payload-short", "payload-long", "count-limit", "bad-rice"}
# Not of a decode of a whole file: annotations, later versions, gathered tiles, truncation, scene indices.
_ELSEWHERE = ("R-7.10-", "R-7.13-", "R-11-", "R-13.2-3", "R-14-", "R-17-")


def checks() -> list[tuple[str, list[str], set[str]]]:
    """(number, rules, ids) of every line; payload ids are those of §5.7 and §5.9, by the rules of these sections."""
    start = text().index("### 12.2 ")
    out = []
    for list_, line, _, cited, else_ in _ROW.findall(text()[start : text().index("### 12.3 ")]):
        ids = set(re.findall(r"`([a-z-]+)`", else_))
        out.append((f"{list_}.{line}", RULE_ID.findall(cited), ids | (_PAYLOAD if "payload ids" in else_ else set())))
    return out


def test_lines_are_numbered_from_one_in_each_list() -> None:
    numbers = [tuple(map(int, number.split("."))) for number, _, _ in checks()]
    lists = sorted({list_ for list_, _ in numbers})
    assert lists == list(range(1, 9))
    for list_ in lists:
        lines = [line for this, line in numbers if this == list_]
        assert lines == list(range(1, len(lines) + 1))


@pytest.mark.parametrize("line", checks(), ids=lambda line: line[0])
def test_a_line_names_ids_that_its_rules_print(line: tuple[str, list[str], set[str]]) -> None:
    _, cited, ids = line
    printed = {id_ for rule in cited for id_ in rules()[rule].refusals}
    assert ids - _PAYLOAD <= printed
    assert not cited or ids & (printed | _PAYLOAD)


def _is_of_a_decode(rule: Rule) -> bool:
    return rule.checked and bool(rule.refusals) and not rule.id.startswith(_ELSEWHERE)


def test_every_rule_with_an_id_is_in_a_line_with_each_of_them() -> None:
    """A reader of a file cut short, who refuses blocks beyond, is no decoder of a whole file."""
    lines = checks()
    listed = {(rule, id_) for _, cited, ids in lines for rule in cited for id_ in ids}
    payload = {rule for rule in rules() if rule.startswith(("R-5.7-", "R-5.9-"))}
    wanted = {(rule.id, id_) for rule in rules().values() if _is_of_a_decode(rule) for id_ in rule.refusals}
    assert {pair for pair in wanted - listed if pair[0] not in payload} == {("R-5.3-8", "truncated-block")}


def test_the_order_is_said_nowhere_else_in_sections_five_to_ten() -> None:
    """One place for it, but for the pseudo-code."""
    start, end = text().index("## 5. "), text().index("## 11. ")
    order = r"[^.]*\b(?:checked (?:in|when|after|before)|applied (?:to|after|when))\b[^.]*\."
    normative = re.sub(r"^>.*$", "", text()[start:end], flags=re.MULTILINE)
    # R-5.9-3 is about quotients, R-6.5-1 says to which layers it applies, R-9.4-3 to what a network is.
    known = ("All n quotients are found before any is checked", "applies this to the", "DECODER_MLP")
    assert [said for said in re.findall(order, normative) if not any(words in said for words in known)] == []

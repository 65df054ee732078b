"""The vectors and tests that exercise each rule of SPEC.md: ``python -m conformance.spec.rules [--write | --check]``.

``rules.json`` is made from SPEC.md, from ``rules`` and refusal ids in the vectors' ``expect.json``, and from
``rule_tests.toml``, which names tests of what no vector can show: duties of encoders, editors and inspectors, and what
a reader does over several files or after a refusal.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from scarfmt_conformance.archive import expectation, names

from conformance.expect.json_text import json_text
from conformance.spec.spec_text import RULE_ID, refusal_classes, rules, text

ROOT = Path(__file__).resolve().parents[2]
RULES = ROOT / "conformance" / "rules.json"
TESTS = ROOT / "conformance" / "rule_tests.toml"
FORMAT = "scar-rules 1"
_OBLIGATION = re.compile(r"\bMUST\b")
# They say what the word means.
_DEFINITIONS = ("are to be read as in RFC 2119",)


@dataclass(frozen=True)
class Vector:
    """The rules that ``expect.json`` of a vector names."""

    id: str
    rules: frozenset[str]
    refusals: frozenset[str]
    result: str


def vectors() -> list[Vector]:
    """Every vector written, by id."""
    out = []
    for id_ in names():
        row = expectation(id_)
        refusals = row.get("refusals", [row["refusal"]] if "refusal" in row else [])
        out.append(Vector(row["id"], frozenset(row["rules"]), frozenset(refusals), row["result"]))
    return out


@cache
def _table() -> dict[str, dict[str, list[str]]]:
    found: dict[str, dict[str, list[str]]] = tomllib.loads(TESTS.read_text())
    return found


def rule_tests() -> dict[str, list[str]]:
    """Rule -> tests, as pytest names them."""
    return _table()["rules"]


def refusal_tests() -> dict[str, list[str]]:
    """Refusal id -> tests, of the ids that a plain question about a file never has for an answer."""
    return _table()["refusals"]


def coverage(known: list[Vector]) -> dict[str, Any]:
    """The content of ``rules.json``."""
    by_rule, by_refusal = rule_tests(), refusal_tests()
    return {
        "format": FORMAT,
        "rules": {
            id_: {
                "text": rule.first_sentence,
                "checked": rule.checked,
                "refusals": list(rule.refusals),
                "vectors": [vector.id for vector in known if id_ in vector.rules],
                "tests": by_rule.get(id_, []),
            }
            for id_, rule in rules().items()
        },
        "refusals": {
            id_: {
                "class": class_,
                "vectors": [vector.id for vector in known if id_ in vector.refusals],
                "tests": by_refusal.get(id_, []),
            }
            for id_, class_ in refusal_classes().items()
        },
    }


def faults(known: list[Vector]) -> list[str]:
    """Faults of the coverage, one line each: uncovered rules and ids, unknown ones, tests that do not exist."""
    return [
        *_find_uncovered(known),
        *_find_unknown(known),
        *_missing_tests(),
        *(f"MUST outside rules: {p}" for p in find_unruled(text())),
    ]


def _find_uncovered(known: list[Vector]) -> Iterator[str]:
    named = {rule for vector in known for rule in vector.rules} | set(rule_tests())
    yield from (f"{rule} has neither vector nor test" for rule in rules() if rule not in named)
    given = {refusal for vector in known for refusal in vector.refusals}
    tested = set(refusal_tests())
    yield from (f"{id_} has neither vector nor test" for id_ in refusal_classes() if id_ not in given | tested)
    pairs = {(rule, refusal) for vector in known for rule in vector.rules for refusal in vector.refusals}
    for rule in rules().values():
        for refusal in rule.refusals:
            if (rule.id, refusal) not in pairs and refusal not in tested:
                yield f"{rule.id} has no vector refused as {refusal}"


def _find_unknown(known: list[Vector]) -> Iterator[str]:
    for vector in known:
        yield from (f"{vector.id} names {rule}, which SPEC.md lacks" for rule in vector.rules - set(rules()))
        yield from (f"{vector.id} names {id_}, which SPEC.md lacks" for id_ in vector.refusals - set(refusal_classes()))
        printed = {id_ for rule in vector.rules & set(rules()) for id_ in rules()[rule].refusals}
        if vector.result == "refused" and not vector.refusals <= printed:
            yield f"{vector.id} is refused as {min(vector.refusals)}, which none of its rules prints"
        if not vector.rules:
            yield f"{vector.id} names no rule"
    yield from (f"{rule} of rule_tests.toml is not in SPEC.md" for rule in set(rule_tests()) - set(rules()))
    yield from (f"{id_} of rule_tests.toml is not in SPEC.md" for id_ in set(refusal_tests()) - set(refusal_classes()))


def _missing_tests() -> Iterator[str]:
    listed = {test for tests in (*rule_tests().values(), *refusal_tests().values()) for test in tests}
    for test in sorted(listed):
        path, _, name = test.partition("::")
        if name not in _functions(ROOT / path):
            yield f"no test {test}"


@cache
def _functions(path: Path) -> frozenset[str]:
    """Names of the functions of a module, none if it is not there."""
    if not path.is_file():
        return frozenset()
    return frozenset(node.name for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef))


def find_unruled(texts: str) -> list[str]:
    """Beginnings of the paragraphs that oblige someone outside every rule."""
    out = []
    for paragraph in re.split(r"\n\n|\n(?=- |\| )", texts):
        line = " ".join(paragraph.split())
        rule = re.match(rf"(- |\| )?\*\*{RULE_ID.pattern}\*\*", line)
        if _OBLIGATION.search(line) and rule is None and not any(words in line for words in _DEFINITIONS):
            out.append(line[:80])
    return out


def main(arguments: list[str]) -> int:
    """Write ``rules.json``, or check it and what it says; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m conformance.spec.rules")
    choice = parser.add_mutually_exclusive_group()
    choice.add_argument("--write", action="store_true", help="write rules.json")
    choice.add_argument("--check", action="store_true", help="compare and write nothing (default)")
    options = parser.parse_args(arguments)
    known = vectors()
    content = json_text(coverage(known), levels=2)
    wrong = faults(known)
    if options.write:
        RULES.write_text(content)
    elif not RULES.exists() or RULES.read_text() != content:
        wrong.append("rules.json is stale: run python -m conformance.spec.rules --write")
    print(f"{len(rules())} rules, {len(refusal_classes())} refusal ids, {len(known)} vectors, {len(wrong)} faults")
    for line in wrong:
        print(f"  {line}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Reports of one score for people, programs and CI servers."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from scarfmt_conformance import report
from scarfmt_conformance.compare import Difference
from scarfmt_conformance.manifest import Suite, Vector
from scarfmt_conformance.protocol import Capabilities
from scarfmt_conformance.runner import FAILED, PASSED, SKIPPED, Failure, Result, Run


def vector(id_: str, *rules: str) -> Vector:
    class_ = id_.partition("/")[0]
    place = Path("/suite") / id_
    features = frozenset({"f"})
    return Vector(
        id_, class_, place / "input.scar", place / "expect.json", 9, "ab", "anchor", features, rules, "decoded"
    )


def scored() -> Run:
    found = tuple(Difference("indices", name, "differs", "<u2 (2)", "<u2 (3)") for name in "abcdefghij")
    failure = Failure("values", "stage indices, array a: differs", 2, found, errors="one\n<two> & ]]>\nthree")
    claims = Capabilities("mine 1", frozenset({"0.1"}), frozenset({"anchor"}), ("models", "indices"))
    results = [
        Result(vector("valid/a"), "p", PASSED, questions=2, seconds=1.5, stages={"models": True}),
        Result(
            vector("valid/b", "R-10.5-1", "R-11-1", "odd"),
            "a <purpose>",
            FAILED,
            failure=failure,
            questions=1,
            seconds=0.5,
            stages={"models": True, "indices": False},
        ),
        Result(vector("edge/c"), "p", SKIPPED, "the anchor profile is not claimed"),
    ]
    return Run(Suite(Path("/suite"), "0.1", ()), claims, None, results, 2.25)


def test_the_tables_count_by_class_and_stage() -> None:
    lines = [line.split() for line in report.score_text(scored()).splitlines()]
    assert lines == [
        ["class", "passed", "failed", "skipped"],
        ["valid", "1", "1", "0"],
        ["edge", "0", "0", "1"],
        ["all", "1", "1", "1"],
        [],
        ["stage", "agrees", "differs"],
        ["models", "2", "0"],
        ["indices", "0", "1"],
    ]
    silent = Run(Suite(Path("/suite"), "0.1", ()), None, Failure("timeout", "capabilities: no answer", errors="why"))
    assert report.score_text(silent).split() == ["class", "passed", "failed", "skipped", "all", *"000"]


def test_junit_xml_parses_and_counts() -> None:
    root = ElementTree.fromstring(report.junit(scored()))
    assert (root.tag, root.get("tests"), root.get("failures"), root.get("skipped")) == ("testsuite", "4", "1", "1")
    case = root.find(".//testcase[@name='valid/b']")
    assert case is not None
    failure = case.find("failure")
    assert failure is not None
    assert failure.get("message") == "stage indices, array a: differs"
    assert "<two> & ]]>" in (failure.text or "")

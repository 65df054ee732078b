"""A score, for people (tables, failures), for programs (JSON) and for CI servers (JUnit XML)."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any
from xml.etree import ElementTree

from scarfmt_conformance.compare import Difference
from scarfmt_conformance.manifest import Vector
from scarfmt_conformance.protocol import CAPABILITIES, STAGES
from scarfmt_conformance.runner import FAILED, PASSED, SKIPPED, Failure, Result, Run

FORMAT = "scar-conformance-report 1"
_OUTCOMES = (PASSED, FAILED, SKIPPED)
_RULE = re.compile(r"R-(\d+(?:\.\d+)?)-\d+")
_ALSO_SHOWN = 6
_ERROR_LINES_SHOWN = 8

Row = Sequence[object]


def sections(rules: Iterable[str]) -> str:
    """Rule ids with the sections of SPEC.md they are in, such as ``R-5.2-4 (SPEC.md §5.2)``."""
    found = [(rule, _RULE.fullmatch(rule)) for rule in rules]
    return ", ".join(f"{rule} (SPEC.md §{match[1]})" if match else rule for rule, match in found)


# ------------------------------------------------------------------------------------------------ for people


def score_text(run: Run) -> str:
    """The tables of a run: vectors by class, and stages compared."""
    by_class: dict[str, Counter[str]] = {}
    for result in run.results:
        by_class.setdefault(result.vector.class_, Counter())[result.outcome] += 1
    rows = [(name, *(counts[outcome] for outcome in _OUTCOMES)) for name, counts in by_class.items()]
    rows.append(("all", *(run.counts()[outcome] for outcome in _OUTCOMES)))
    text = table(("class", *_OUTCOMES), rows)
    stages = [(stage, agree, differ) for stage, (agree, differ) in _stage_counts(run).items()]
    return text + ("\n" + table(("stage", "agrees", "differs"), stages) if stages else "")


def _stage_counts(run: Run) -> dict[str, tuple[int, int]]:
    """Vectors in which a stage agrees, and differs, of the stages compared at all."""
    out = {}
    for stage in STAGES:
        seen = [result.stages[stage] for result in run.results if stage in result.stages]
        if seen:
            out[stage] = (sum(seen), len(seen) - sum(seen))
    return out


def table(head: Row, rows: Sequence[Row]) -> str:
    """Rows under a head: the first column and texts to the left, numbers to the right."""
    cells = [[str(cell) for cell in row] for row in (head, *rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    numeric = [isinstance(cell, int) for cell in (rows[0] if rows else head)]
    lines = [
        "  ".join(c.rjust(w) if n else c.ljust(w) for c, w, n in zip(row, widths, numeric, strict=True)).rstrip()
        for row in cells
    ]
    return "\n".join(lines) + "\n"


def list_text(vectors: Sequence[Vector]) -> str:
    """Vectors, one a line."""
    rows = [
        (vector.id, vector.result, vector.profile or "-", vector.bytes, " ".join(sorted(vector.features)))
        for vector in vectors
    ]
    return table(("id", "result", "profile", "bytes", "features"), rows)


def failure_text(result: Result) -> str:
    """Everything about a failed vector that helps to find the bug, several lines."""
    failure = result.failure
    assert failure is not None
    layer = f", layer {failure.layer}" if failure.layer else ""
    lines = [f"FAILED {result.vector.id}{layer}: {failure.message}"]
    lines += [f"    {name:<8}  {value}" for name, value in _details(result, failure) if value]
    shown = failure.errors.splitlines()[-_ERROR_LINES_SHOWN:]
    lines += [f"    {'stderr' if number == 0 else '':<8}  {line}" for number, line in enumerate(shown)]
    return "\n".join(lines)


def _details(result: Result, failure: Failure) -> list[tuple[str, str]]:
    first = failure.differences[0] if failure.differences else None
    return [
        ("purpose", result.purpose),
        ("expected", first.expected if first else failure.expected),
        ("got", first.got if first else failure.got),
        ("also", _also(failure.differences[1:])),
        ("rules", sections(result.vector.rules)),
        ("file", str(result.vector.file)),
    ]


def _also(others: Sequence[Difference]) -> str:
    if not others:
        return ""
    names = list(dict.fromkeys(f"{other.stage} {other.array}".strip() for other in others))
    more = f" and {len(names) - _ALSO_SHOWN} more" if len(names) > _ALSO_SHOWN else ""
    return ", ".join(names[:_ALSO_SHOWN]) + more


def handshake_text(failure: Failure) -> str:
    """Why a decoder could not be asked at all."""
    return "\n".join([f"FAILED {failure.message}", *(f"    {line}" for line in failure.errors.splitlines())])


def failures_text(run: Run, most: int) -> str:
    """Up to `most` failures, why vectors were skipped, and a line that sums up: who, how many, how long."""
    failed = [result for result in run.results if result.failure is not None]
    parts = [] if run.handshake is None else [handshake_text(run.handshake)]
    parts += [failure_text(result) for result in failed[:most]]
    if len(failed) > most:
        parts.append(f"{len(failed) - most} more failures: -v shows them, --format json and --junit keep them")
    skips = Counter(result.reason for result in run.results if result.outcome == SKIPPED)
    parts += [f"skipped {count}: {reason}" for reason, count in skips.most_common()]
    counts, who = run.counts(), run.capabilities.decoder if run.capabilities else "the decoder"
    totals = f"{counts[PASSED]} passed, {counts[FAILED]} failed, {counts[SKIPPED]} skipped"
    return "\n".join([*parts, f"{who}: {totals}; {run.seconds:.1f} s"])


# ------------------------------------------------------------------------------------------------ for programs


def as_json(run: Run, command: Sequence[str]) -> dict[str, Any]:
    """The report as a JSON object (docs/write-a-decoder.md)."""
    claims = run.capabilities
    return {
        "format": FORMAT,
        "bitstream": run.suite.bitstream,
        "command": list(command),
        "decoder": None
        if claims is None
        else {
            "name": claims.decoder,
            "versions": sorted(claims.versions),
            "profiles": sorted(claims.profiles),
            "stages": list(claims.stages),
        },
        "passed": run.passed,
        "counts": {outcome: run.counts()[outcome] for outcome in _OUTCOMES},
        "stages": {stage: {"agrees": a, "differs": d} for stage, (a, d) in _stage_counts(run).items()},
        "seconds": round(run.seconds, 3),
        "handshake": run.handshake and _failure_json(run.handshake),
        "vectors": [_result_json(result) for result in run.results],
    }


def _result_json(result: Result) -> dict[str, Any]:
    return {
        "id": result.vector.id,
        "class": result.vector.class_,
        "outcome": result.outcome,
        "reason": result.reason,
        "questions": result.questions,
        "seconds": round(result.seconds, 4),
        "stages": result.stages,
        "rules": list(result.vector.rules),
        "failure": result.failure and {"purpose": result.purpose, **_failure_json(result.failure)},
    }


def _failure_json(failure: Failure) -> dict[str, Any]:
    fields = asdict(failure)
    fields["stderr"] = fields.pop("errors")
    return fields


def junit(run: Run) -> bytes:
    """The report as JUnit XML: a test case per vector, and one for the handshake."""
    suite = ElementTree.Element("testsuite", name="scar-conformance", time=f"{run.seconds:.3f}")
    text = None if run.handshake is None else handshake_text(run.handshake)
    _case(suite, CAPABILITIES, CAPABILITIES, run.handshake, text)
    for result in run.results:
        text = None if result.failure is None else failure_text(result)
        case = _case(suite, result.vector.class_, result.vector.id, result.failure, text)
        case.set("time", f"{result.seconds:.3f}")
        if result.outcome == SKIPPED:
            ElementTree.SubElement(case, "skipped", message=result.reason)
    for name, element in (("tests", "testcase"), ("failures", "failure"), ("skipped", "skipped")):
        suite.set(name, str(sum(1 for _ in suite.iter(element))))
    ElementTree.indent(suite)
    data: bytes = ElementTree.tostring(suite, encoding="utf-8", xml_declaration=True)
    return data + b"\n"


def _case(
    suite: ElementTree.Element, class_: str, name: str, failure: Failure | None, text: str | None
) -> ElementTree.Element:
    case = ElementTree.SubElement(suite, "testcase", name=name, classname=f"scar-conformance.{class_}")
    if failure is not None:
        ElementTree.SubElement(case, "failure", type=failure.kind, message=failure.message).text = text
    return case

"""The tables of `benchmarks.stability`, and the faults among its findings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.report import table
from benchmarks.stability_values import reaches

_USUAL = "as usual"


def failures(results: Mapping[str, Any]) -> list[str]:
    """A line for everything that differs or exceeds its tolerance."""
    files = [f"{way}: {place}" for way, (_, _, wrong) in results["files"].items() for place in wrong]
    processes = [name for name, found in results["processes"].items() if found.get("differ") != []]
    encoder = [name for name, digest in results["encoder"].items() if digest != results["encoder"][_USUAL]]
    exact = [edge["operation"] for edge in results["exact"] if edge["differ"]]
    beyond = [f"{row['operation']}: {row['used']:,.1f} times the tolerance" for row in results["activated"]
              if row["used"] > 1]  # fmt: skip
    return [*files, *processes, *(f"encoder, {name}" for name in encoder), *exact, *beyond]


def markdown(results: Mapping[str, Any]) -> str:
    """The tables of the page."""
    parts = ["### Every operation", _operations(results["exact"], results["activated"])]
    parts += ["### The reference itself", _references(results["activated"])]
    parts += ["### Largest accumulators", _reaches()]
    parts += ["### Files, every way", _files(results["files"], results["real"])]
    parts += ["### Files, in other processes", _processes(results["processes"])]
    parts += ["### The encoder", _encoder(results["encoder"])]
    return "\n\n".join(part.rstrip() for part in parts)


def _operations(exact: Sequence[Mapping[str, Any]], activated: Sequence[Mapping[str, Any]]) -> str:
    rows = []
    for edge in exact:
        error = f"{edge['differ']:,} differ" if edge["differ"] else "none differ"
        reached = f"{edge['worst']} ({edge['limit']})"
        rows.append([edge["operation"], "exact", f"{edge['cases']:,}", error, "0", "", reached])
    for row in activated:
        error = f"{row['error']:.2g} ({_ulps(row['ulps'])})"
        inputs = ", ".join(f"{name} {value:.4g}" for name, value in _shown(row))
        given = f"{inputs}: {row['found']:.7g}, not {row['wanted']:.7g}"
        rows.append(
            [row["operation"], "tolerance", f"{row['cases']:,}", error, "10⁻⁵ max(1, m)", _margin(row["used"]), given]
        )
    return table(["operation", "class", "cases", "worst error", "bound", "margin", "worst case"], rows, 2)


def _shown(row: Mapping[str, Any]) -> list[tuple[str, float]]:
    return list(zip(row["columns"], row["inputs"], strict=True))


def _ulps(ulps: float) -> str:
    return f"{ulps:.2f} ulp" if ulps < 1e4 else f"{ulps:.1e} ulp"


def _margin(used: float) -> str:
    if used > 1:
        return f"**exceeded {used:,.0f} times**"
    return "no error" if used == 0 else f"{1 / used:,.0f}"


def _references(activated: Sequence[Mapping[str, Any]]) -> str:
    rows = [[row["operation"], f"{row['reference']:.1e}"] for row in activated if row["reference"] is not None]
    intro = "The part of the tolerance that float64 leaves open, against 50 digits; above 1 the rule decides nothing."
    return f"{intro}\n\n{table(['operation', 'part of the tolerance'], rows)}"


def _reaches() -> str:
    rows = [[what, f"{most:,}", f"2^{limit.bit_length() - 1}", f"{limit / most:,.4g}", rule]
            for what, most, limit, rule in reaches()]  # fmt: skip
    return table(["number", "largest", "stays below", "margin", "by"], rows)


def _files(files: Mapping[str, Sequence[Any]], real: Sequence[str]) -> str:
    grouped: dict[str, list[Any]] = {}
    for name, (decodes, arrays, wrong) in files.items():
        key = "random order of tiles, rows and sums" if name.startswith("order ") else name
        before = grouped.get(key, [0, 0, 0, 0])
        grouped[key] = [before[0] + 1, before[1] + decodes, before[2] + arrays, before[3] + len(wrong)]
    rows = [[key, *(f"{number:,}" for number in numbers)] for key, numbers in grouped.items()]
    head = ["decoded with", "ways", "decodes", "arrays compared", "of which differ"]
    return f"Conformance vectors, and {', '.join(real)}.\n\n{table(head, rows)}"


def _processes(found: Mapping[str, Mapping[str, Any]]) -> str:
    rows = []
    for name, one in found.items():
        if "failed" in one:
            rows.append([name, "", f"ended with {one['failed']}", "", ""])
            continue
        same = "yes" if one["same"] else "no"
        rows.append([name, f"{one['files']}", f"{len(one['differ'])}", same, _margin(one["worst"])])
    head = ["process", "files", "exact values differ in", "activated float32 bits of one file as usual", "its margin"]
    return table(head, rows)


def _encoder(found: Mapping[str, str]) -> str:
    rows = [[name, digest[:12], "yes" if digest == found[_USUAL] else "**no**"] for name, digest in found.items()]
    return table(["process", "SHA-256 of the file", "as usual"], rows)

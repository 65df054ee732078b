"""The recorded campaigns as a table of docs/fuzzing.md: ``python -m fuzz.report``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from benchmarks.provenance import statement
from benchmarks.report import replace_section, table
from benchmarks.scenes import REPOSITORY

RESULTS = Path(__file__).with_name("results")
PAGE = REPOSITORY / "docs" / "fuzzing.md"
SECTION = "campaigns"
_WHAT = {"mutants": "damage of any kind", "deep": "other content, checksums right", "bit-flips": "single bits flipped"}


def markdown(campaigns: list[dict[str, Any]]) -> str:
    """A row for each campaign, and below when and on what it ran."""
    head = ["damage", "inputs", "corpus, files", "decoded", "engines compared", "findings", "slowest s", "MiB", "min"]
    rows = [
        [
            _WHAT[found["kind"]],
            f"{found['inputs']:,}",
            f"{found['corpus']['files']:,}",
            f"{found['outcomes'].get('decode accepted', 0):,}",
            f"{found['outcomes'].get('engines compared', 0):,}",
            f"**{len(found['findings'])}**",
            f"{max((row[0] for row in found['slowest_seconds']), default=0.0):.2f}",
            f"{max((row[0] for row in found['most_bytes']), default=0) >> 20}",
            f"{found['wall_seconds'] / 60:.0f}",
        ]
        for found in campaigns
    ]
    dates = [f"- {_WHAT[found['kind']]}, seed {found['seed']}, corpus SHA-256 `{found['corpus']['sha256'][:16]}...`:\n"
             f"  {statement(found)}" for found in campaigns]  # fmt: skip
    return "\n".join([table(head, rows), *dates])


def main() -> None:
    campaigns = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(RESULTS.glob("*.json"))]
    replace_section(SECTION, markdown(campaigns), PAGE)


if __name__ == "__main__":
    main()

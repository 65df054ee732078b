"""The table of docs/compare.md: default settings of two rivals, and what `.scar` needs to be as good as they are.

``python -m benchmarks.compare_formats`` writes it, from the results of `benchmarks.rivals_run` and
`benchmarks.quality`; it measures nothing.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

from benchmarks.judged import levels_text
from benchmarks.quality_report import NAME as QUALITY
from benchmarks.quality_report import equal_cells, title
from benchmarks.report import dated, load_results, replace_section, table
from benchmarks.rivals_report import NAME, gathered
from benchmarks.scenes import REPOSITORY
from benchmarks.verdicts import LEVELS, LOSSLESS_DB

PAGE = REPOSITORY / "docs" / "compare.md"
SECTION = "compare-formats"
RIVALS = ("SPZ v4", "SOG")
"""At the settings that their programs choose."""
_HEAD = (
    "scene", "SH", "rival", "B/G", "mean / 5 % / worst, dB", "`.scar` at its mean, B/G", "ratio",
    "`.scar` at all three, B/G", "ratio", "rival: encode, decode s", "`.scar`: encode, decode s",
)  # fmt: skip

Run = dict[str, Any]


def comparison(runs: Sequence[Run]) -> str:
    """A row for each scene and rival, but where the scene came from a file of that rival, which then loses nothing."""
    rows = [
        _row(run, rival)
        for run in runs
        for rival in run["rivals"]
        if run["scar"] and rival["name"] in RIVALS and rival["psnr_db"] < LOSSLESS_DB
    ]
    return table(list(_HEAD), rows, 3)


def _row(run: Run, rival: Run) -> list[str]:
    files = [file["layers"][-1] for file in run["scar"]]
    cells = [title(run["scene"]), str(run["sh_degree"]), rival["name"], f"{rival['bytes'] / run['count']:.2f}"]
    cells += [levels_text(rival), *equal_cells(run, files, rival, LEVELS[:1]), *equal_cells(run, files, rival)]
    return [*cells, _seconds([rival]), _seconds(run["scar"])]


def _seconds(files: Sequence[Run]) -> str:
    """Seconds to encode and decode; of several files, from the least to the most."""
    texts = []
    for kind in ("encode_seconds", "decode_seconds"):
        times = [float(file[kind]) for file in files]
        least, most = (f"{time:.0f}" if time >= 10 else f"{time:.2g}" for time in (min(times), max(times)))
        texts.append(least if least == most else f"{least} to {most}")
    return ", ".join(texts)


def write_page(runs: Sequence[Run]) -> None:
    """Put the table into docs/compare.md, with when and where each half of it was measured."""
    text = dated(comparison(runs), NAME)
    replace_section(SECTION, f"{text}\n\n`.scar`: {dated('', QUALITY).strip()}", PAGE)


if __name__ == "__main__":
    write_page(gathered(list(load_results(NAME).values())))
    sys.exit(0)

"""Files that once took too long or too much memory are refused or read at once."""

from __future__ import annotations

import re
import time
import tracemalloc
from pathlib import Path

import pytest

from fuzz.target import decode_all, validate_all

FOLDER = Path(__file__).resolve().parents[2] / "fuzz" / "regressions"
TABLE = (FOLDER / "README.md").read_text()
ROWS = dict(re.findall(r"^\| `([\w-]+)\.scar` \| (?:`([\w-]+)`)? *\|", TABLE, re.MULTILINE))


def test_the_table_lists_the_files() -> None:
    """None is forgotten."""
    assert set(ROWS) == {path.stem for path in FOLDER.glob("*.scar")}


@pytest.mark.parametrize("name", ROWS)
def test_a_regression(name: str) -> None:
    """The refusal in the table, in little memory; time only against the minutes it once was."""
    data = (FOLDER / f"{name}.scar").read_bytes()
    start = time.process_time()
    tracemalloc.start()
    found, peak = decode_all(data), tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found == validate_all(data) == ROWS[name]
    assert peak < 64 << 20
    assert time.process_time() - start < 60

"""Bytes at equal quality: interpolated between files, never beyond them, and by what lacks most."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks import judged
from benchmarks.verdicts import LEVELS, best, equal_bytes, lead, smallest


def row(size: int, mean: float, low: float, worst: float) -> dict[str, Any]:
    return {"name": f"{size}", "bytes": size, "psnr_db": mean, "p5_psnr_db": low, "worst_psnr_db": worst}


def test_what_lacks_most_counts() -> None:
    assert lead(row(1, 45, 41, 38), row(1, 44, 43, 37)) == -2


def test_bytes_are_between_the_files_around() -> None:
    """Mean is reached at once, the worst view half way from the first file to the second."""
    files = [row(400, 50, 40, 38), row(100, 44, 36, 30)]
    assert equal_bytes(files, row(0, 40, 30, 34)) == pytest.approx(200)
    assert equal_bytes(files, row(0, 40, 30, 34), LEVELS[:1]) == 100


def test_nothing_is_extrapolated() -> None:
    files = [row(400, 50, 40, 38), row(100, 44, 36, 30)]
    assert equal_bytes(files, row(0, 50, 40, 39)) is None
    assert equal_bytes(files, row(0, 20, 20, 20)) == 100
    assert equal_bytes([], row(0, 20, 20, 20)) is None


def test_a_larger_file_that_is_worse_does_not_count() -> None:
    files = [row(100, 40, 40, 40), row(200, 44, 44, 44), row(300, 42, 42, 42)]
    assert equal_bytes(files, row(0, 44, 44, 44)) == pytest.approx(200)


def test_smallest_rival_is_by_its_mean() -> None:
    rivals = [row(3, 50, 1, 1), row(2, 42, 1, 1), row(1, 40, 1, 1)]
    found = smallest(rivals, 41)
    assert found is not None
    assert found["bytes"] == 2
    assert smallest(rivals, 51) is None


def test_best_rivals_are_those_nothing_beats() -> None:
    """In size, mean, low end and worst view; neither dim nor lossless ones."""
    rivals = [row(1, 20, 20, 20), row(2, 40, 38, 36), row(3, 41, 37, 37), row(4, 40, 38, 37), row(5, 41, 37, 37)]
    lossless = row(9, judged.EQUAL_DB, judged.EQUAL_DB, judged.EQUAL_DB)
    assert [found["bytes"] for found in best([*rivals, lossless], 36)] == [2, 3, 4]
    assert len(best([row(2, 40, 38, 36), row(2, 40, 38, 36)], 36)) == 2

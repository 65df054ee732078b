"""The table of docs/compare.md: rivals where they stand, gaps where ours are not as good."""

from __future__ import annotations

from typing import Any

from benchmarks.compare_formats import comparison


def _file(size: int, mean: float, worst: float, seconds: float = 100.0) -> dict[str, Any]:
    layer = {"bytes": size, "psnr_db": mean, "p5_psnr_db": worst, "worst_psnr_db": worst}
    return {"layers": [layer], "encode_seconds": seconds, "decode_seconds": 0.5}


def _rival(name: str, mean: float, worst: float) -> dict[str, Any]:
    levels = {"psnr_db": mean, "p5_psnr_db": worst, "worst_psnr_db": worst}
    return {"name": name, "bytes": 10_000, "encode_seconds": 2.0, "decode_seconds": 0.01, **levels}


def _run(*rivals: dict[str, Any]) -> dict[str, Any]:
    files = [_file(4_000, 40.0, 30.0), _file(6_000, 46.0, 36.0, 120.0)]
    return {"scene": "massa", "count": 1000, "sh_degree": 0, "rivals": list(rivals), "scar": files}


def test_a_rival_that_is_better_is_shown_as_not_reached() -> None:
    """In the mean, or in the worst view alone."""
    rows = comparison([_run(_rival("SOG", 50.0, 30.0), _rival("SPZ v4", 43.0, 40.0))]).splitlines()[2:]
    assert [row.count("not reached") for row in rows] == [2, 1]
    assert "2, 0.01 | 100 to 120, 0.5 |" in rows[0]


def test_what_loses_nothing_and_other_settings_are_left_out() -> None:
    rows = comparison([_run(_rival("SPZ v4", 100.0, 100.0), _rival("SPZ v4, SH 8+8 bit", 43.0, 33.0))]).splitlines()
    assert len(rows) == 2

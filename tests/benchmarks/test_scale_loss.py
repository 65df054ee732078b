"""The loss in ranges is read where files in memory have the same PSNR, and never beyond them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks import report, scale_loss
from benchmarks.scale_loss import bytes_at, loss, shown


def file(size: int, psnr_db: float) -> dict[str, Any]:
    return {"bytes": size, "psnr_db": psnr_db, "kinds": {}}


MEMORY = [file(4000, 48.0), file(1000, 42.0), file(2000, 45.0)]


def result(scene: str, here: dict[str, Any], gaussians: int = 1000, effort: int = 1) -> dict[str, Any]:
    counted = {"gaussians": gaussians, "ranges": 4}
    return {"scene": scene, "fitted": False, "effort": effort, **counted, "in_ranges": here, "in_memory": MEMORY}


def test_bytes_grow_evenly_in_their_logarithm_between_files() -> None:
    assert bytes_at(MEMORY, 45.0) == pytest.approx(2000)
    assert bytes_at(MEMORY, 43.5) == pytest.approx(1000 * 2**0.5)
    assert bytes_at(MEMORY, 47.0) == pytest.approx(2000 * 2 ** (2 / 3))


@pytest.mark.parametrize("psnr_db", [41.9, 48.1])
def test_nothing_is_said_of_a_level_that_was_not_measured(psnr_db: float) -> None:
    with pytest.raises(ValueError, match="measure other qualities"):
        bytes_at(MEMORY, psnr_db)


def test_a_loss_is_of_bytes_at_the_level_of_the_ranges() -> None:
    """Not at the quality that was asked for: ranges that came out worse are no gain."""
    assert loss(result("a", file(2200, 45.0))) == pytest.approx(0.1)
    assert loss(result("a", file(2000, 43.5))) == pytest.approx(2**0.5 - 1)


def test_the_worst_scene_of_each_effort_is_named() -> None:
    results = {
        "a e1": result("a", file(2100, 45.0)),
        "b e1": result("b", file(2020, 45.0), 5000),
        "a e2": result("a", file(1980, 45.0), effort=2),
    }
    lines = shown(results).splitlines()
    assert [line.split(" | ")[0] for line in lines[2:5]] == ["| b", "| a", "| a"]
    assert lines[-2].startswith("Effort 1: +3.0 % on average of 2 scenes, +5.0 % at worst (a)")
    assert lines[-1].startswith("Effort 2: -1.0 % on average of 1 scenes, -1.0 % at worst (a)")


@pytest.mark.slow
def test_the_short_mode_measures_and_prints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(report, "SHORT_RESULTS", tmp_path)
    monkeypatch.setattr(sys, "argv", ["scale_loss", "--short", "--no-write"])
    scale_loss.main()
    assert "| plush-toys † | 1 | " in capsys.readouterr().out

"""Large scenes are what they are said to be, and figures of them are put together right."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import large_scene
from benchmarks.large_scene import BANDWIDTH, Steps, efficiencies, model, moved_bytes, runs_table
from benchmarks.large_scene_copies import write_copies
from benchmarks.scenes import chosen
from benchmarks.watched import Watch
from scarfmt.formats import load
from scarfmt.formats.clean import clean
from scarfmt.scene.gaussians import GaussianScene


def read(path: Path) -> GaussianScene:
    scene = load(path)
    assert isinstance(scene, GaussianScene)
    return scene


def test_copies_are_the_scene_again_elsewhere_and_never_the_same(tmp_path: Path) -> None:
    [place] = chosen(["plush-toys"])
    source, _ = clean(read(place.path), drop_invalid=True)
    count = 2 * len(source) + 500
    write_copies(place, count, tmp_path / "a.ply")
    made = read(tmp_path / "a.ply")
    assert len(made) == count
    clean(made)
    first, second = made.rows(slice(0, len(source))), made.rows(slice(len(source), 2 * len(source)))
    assert np.array_equal(first.log_scales, source.log_scales)
    moved = second.positions - first.positions
    assert np.linalg.norm(np.median(moved, axis=0)) > 0
    assert np.ptp(moved, axis=0).max() > 0
    assert not (second.sh == first.sh).any(axis=(1, 2)).all()
    write_copies(place, count, tmp_path / "b.ply")
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_a_watch_sees_processes_of_processes() -> None:
    """Workers are children of a server of processes, not of the one that asks for them."""
    inner = "x = bytearray(200_000_000); import time; s = time.time()\nwhile time.time() < s + 1.5: pass"
    outer = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {inner!r}])"
    with Watch() as watch:
        subprocess.run([sys.executable, "-c", outer], check=True)
    assert watch.peak_bytes > 200_000_000
    assert watch.cpu_seconds > 0.3


def test_steps_get_the_time_between_their_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 1.0, 4.0, 10.0, 11.0])
    monkeypatch.setattr(time, "perf_counter", lambda: next(clock))
    steps = Steps()
    for said in ("scan", "scan: 3 to do", "bin: 2 to do", "scan"):
        steps.report(said, 0.0)
    steps.end()
    assert steps.seconds == {"scan": 4.0, "bin": 6.0}


def run(gaussians: int, workers: int = 1, **changes: Any) -> dict[str, Any]:
    """Takes 10 s and a microsecond a Gaussian alone, 50 microseconds a Gaussian besides."""
    steps = {"fit": 10 + 1e-6 * gaussians, "measure": 50e-6 * gaussians}
    usual = {"seconds": sum(steps.values()), "cpu": 60.0, "peak_bytes": 2**30, "worker_peak_bytes": 0, "bytes": 10}
    kept = {"bins": 200 * gaussians, "segments": 10 * gaussians}
    more = {"gaussians": gaussians, "workers": workers, "executor": "processes", "effort": 1, "mean_db": 44.0}
    return {**usual, **more, "source_bytes": 100 * gaussians, "kept": kept, "steps": steps, **changes}


def test_the_model_tells_what_is_serial_from_what_is_shared() -> None:
    serial, parallel, moving = model([run(10**6), run(4 * 10**6)], 1e8, 100)
    assert serial == pytest.approx(10 + 1e-6 * 1e8)
    assert parallel == pytest.approx(50e-6 * 1e8 / 100)
    assert moved_bytes(run(1)["kept"], 100) == 300 + 4 * 200 + 2 * 10
    assert moving == pytest.approx(1120 * 1e8 / 100 / BANDWIDTH)


def test_small_scenes_tell_nothing_of_large_ones() -> None:
    """The time of small scenes is mostly that of the fit, and noise."""
    assert large_scene.models({"small": run(8000)}) == []
    assert len(large_scene.models({"large": run(10**7), "larger": run(5 * 10**7)})) == 1


def test_two_workers_are_compared_with_one_of_the_same_scene() -> None:
    results = {"one": run(10**6, seconds=100.0), "two": run(10**6, 2, seconds=62.5), "more": run(2 * 10**6, 2)}
    assert [line.rpartition(" ")[2] for line in efficiencies(results)] == ["0.80."]
    assert runs_table(results).count("\n") == 5


@pytest.mark.slow
def test_the_short_mode_measures_and_prints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["large_scene", "--short", "--no-write", "--scratch", str(tmp_path), "--workers", "1", "2"]
    patch = pytest.MonkeyPatch()
    with patch.context() as changed:
        changed.setattr(sys, "argv", arguments)
        large_scene.main()
    text = capsys.readouterr().out
    assert "this process" in text
    assert "2 processes" in text
    assert "efficiency" in text

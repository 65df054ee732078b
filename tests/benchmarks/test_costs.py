"""Time and scale: equal error, where a picture comes first, slopes, and scenes made of copies."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.process_watch import Watch
from benchmarks.scene_copies import write_copies
from benchmarks.scenes import load_gaussians, select_scenes
from benchmarks.time import bandwidths_won, bytes_at_equal_error, format_span, seconds_to_picture
from scarfmt.scene.gaussians import GaussianScene

MEGABIT = 125_000


def effort_run(effort: int, psnr: float, size: int) -> dict[str, Any]:
    return {"effort": effort, "psnr_db": psnr, "bytes": size}


def test_efforts_are_compared_where_all_have_files_on_both_sides() -> None:
    """At the best PSNR of the lower quality; halfway in dB is the geometric mean of bytes."""
    runs = [effort_run(1, 40.0, 100), effort_run(1, 44.0, 400), effort_run(2, 42.0, 150), effort_run(2, 43.0, 300)]
    goal, equal = bytes_at_equal_error(runs)
    assert goal == 42.0
    assert equal == pytest.approx({1: 200.0, 2: 150.0})
    with pytest.raises(ValueError, match="both sides"):
        bytes_at_equal_error([*runs[:1], effort_run(1, 41.0, 120), *runs[2:]])


def way(size: int, seconds: float) -> dict[str, Any]:
    return {"bytes": size, "decode": {"one": {"median": seconds}}}


@pytest.mark.parametrize(
    ("mine", "text"),
    [
        (way(MEGABIT, 0.3), "below 10"),
        (way(MEGABIT, 0.05), "everywhere"),
        (way(4 * MEGABIT, 0.3), "nowhere"),
        (way(4 * MEGABIT, 0.05), "above 20"),
    ],
)
def test_a_picture_is_first_where_transfer_and_decoding_take_less(mine: dict[str, Any], text: str) -> None:
    """Against 3 megabits and 0.1 s: at the crossing both take as long."""
    other = way(3 * MEGABIT, 0.1)
    span = bandwidths_won(mine, other, "one")
    assert format_span(span) == text
    for mbit in (1, 5, 9, 11, 19, 21, 1000):
        inside = span is not None and span[0] < mbit < span[1]
        assert inside == (seconds_to_picture(mine, "one", mbit) < seconds_to_picture(other, "one", mbit))
    for edge in span or ():
        if 0 < edge < math.inf:
            assert seconds_to_picture(mine, "one", edge) == pytest.approx(seconds_to_picture(other, "one", edge))


def test_copies_are_the_scene_again_elsewhere_and_never_the_same(tmp_path: Path) -> None:
    [place] = select_scenes(["plush-toys"])
    source = load_gaussians(place.path)
    count = 2 * len(source) + 500
    write_copies(place, count, tmp_path / "a.ply")
    made = load_gaussians(tmp_path / "a.ply")
    assert isinstance(made, GaussianScene)
    assert isinstance(source, GaussianScene)
    assert len(made) == count
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
    assert watch.cpu_seconds > 0

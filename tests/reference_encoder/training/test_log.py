"""The log of a training: a line for each report, none about what happens again, and a picture of it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from reference_encoder.training import log
from reference_encoder.training.log import LOG, PLOT, RunLog, read_log
from reference_encoder.training.options import Progress

PROGRESS = Progress(10, 100, 1.0, 9.0, "grow", 21.5, None, 1000, 4000, 0.25)


def test_lines_say_what_was_reported(tmp_path: Path) -> None:
    """NaN and infinity, which JSON lacks, are null."""
    with RunLog(tmp_path / "run") as found:
        found.note(PROGRESS, ssim=0.8)
        found.note(replace(PROGRESS, iteration=20, psnr=math.nan, seconds_left=math.inf))
    first, second = read_log(tmp_path / "run")
    assert (first["iteration"], first["psnr"], first["bytes"], first["phase"]) == (10, 21.5, None, "grow")
    assert first["ssim"] == 0.8
    assert (second["psnr"], second["seconds_left"]) == (None, None)


def test_lines_after_the_checkpoint_are_dropped(tmp_path: Path) -> None:
    """Half a line, on which the process was killed, is dropped, too."""
    with RunLog(tmp_path) as found:
        for iteration in (10, 20, 30):
            found.note(replace(PROGRESS, iteration=iteration))
    with (tmp_path / LOG).open("ab") as stream:
        stream.write(b'{"iteration": 4')
    with RunLog(tmp_path, iteration=20) as found:
        found.note(replace(PROGRESS, iteration=25))
    assert [entry["iteration"] for entry in read_log(tmp_path)] == [10, 20, 25]
    with RunLog(tmp_path):
        pass
    assert read_log(tmp_path) == []


def test_lines_are_on_the_disk_at_once_and_the_plot_every_few_minutes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr(log.time, "monotonic", lambda: now[0])
    with RunLog(tmp_path) as found:
        found.note(PROGRESS)
        assert len(read_log(tmp_path)) == 1
        assert not (tmp_path / PLOT).exists()
        now[0] += log.DRAW_EVERY_SECONDS
        found.note(PROGRESS)
        with Image.open(tmp_path / PLOT) as picture:
            assert min(picture.size) > 300
        (tmp_path / PLOT).unlink()
    assert (tmp_path / PLOT).is_file()

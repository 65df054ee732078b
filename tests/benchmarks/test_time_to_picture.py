"""Time to a picture: where one way is sooner, whose files are compared, and what the page shows."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks import plots
from benchmarks.plots import MOST_BYTES
from benchmarks.report import replace_section
from benchmarks.rivals_formats import formats
from benchmarks.time_to_picture import QUALITIES, fastest
from benchmarks.time_to_picture_files import FAMILIES, SCAR, SETTINGS, Way, chosen_rivals, read_job, timed_as
from benchmarks.time_to_picture_plots import draw
from benchmarks.time_to_picture_tables import PAGE, seconds_to, sooner, span_text, tables
from fuzz.testing.scenes import random_scene
from reference_encoder.options import EncodeOptions
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from tests.benchmarks.test_rivals import scene
from tests.conftest import REPOSITORY

MEGABIT = 125_000


def way(size: int, seconds: float, **more: Any) -> dict[str, Any]:
    times = {"min": seconds / 2, "median": seconds, "reader": "r"}
    facts = {"family": SCAR, "name": "default", "goal": 41.0, "psnr_db": 41.2, "layers": 3, "note": ""}
    return {**facts, "bytes": size, "decode": {"one": times, "all": times}, **more}


def record() -> dict[str, Any]:
    mine = [way(MEGABIT, 0.3, name=name, goal=goal) for name in SETTINGS for goal in (25.0, 41.0)]
    theirs = [way(3 * MEGABIT, 0.1, family=name, name=name, goal=goal) for name in FAMILIES for goal in (25.0, 41.0)]
    start = {SCAR: {"import": 0.5, "first_more": 0.1, "open": 0.002}, "gsply": {"import": 0.4, "first_more": 1.0}}
    facts = {
        "scene": "flowers",
        "note": "a note",
        "count": 5,
        "quality": 41.0,
        "effort": 2,
        "missing": ["flowers: why"],
    }
    return {**facts, "ways": [*mine, *theirs], "start": start}


def test_time_is_transfer_and_decoding_one_after_the_other() -> None:
    assert seconds_to(way(MEGABIT, 0.5), "one", 1) == pytest.approx(1.5)
    assert seconds_to(way(MEGABIT, 0.5), "one", 10) == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("mine", "text"),
    [
        (way(MEGABIT, 0.3), "below 10"),
        (way(MEGABIT, 0.05), "everywhere"),
        (way(4 * MEGABIT, 0.3), "nowhere"),
        (way(4 * MEGABIT, 0.05), "above 20"),
    ],
)
def test_where_ours_is_sooner(mine: dict[str, Any], text: str) -> None:
    """Against 3 megabits and 0.1 s: at the crossing both take as long, and on its two sides the tables agree."""
    other = way(3 * MEGABIT, 0.1)
    span = sooner(mine, other, "one")
    assert span_text(span) == text
    for mbit in (1, 5, 9, 11, 19, 21, 1000):
        inside = span is not None and span[0] < mbit < span[1]
        assert inside == (seconds_to(mine, "one", mbit) < seconds_to(other, "one", mbit))
    for edge in span or ():
        if 0 < edge < math.inf:
            assert seconds_to(mine, "one", edge) == pytest.approx(seconds_to(other, "one", edge))


def test_of_a_format_the_smallest_file_that_is_good_enough_counts() -> None:
    rivals = [
        {"family": "spz", "name": "a", "bytes": 10, "psnr_db": 38.0},
        {"family": "spz", "name": "c", "bytes": 30, "psnr_db": 45.0},
        {"family": "spz", "name": "b", "bytes": 20, "psnr_db": 41.0},
        {"family": "sog", "name": "d", "bytes": 15, "psnr_db": 40.9},
    ]
    found = [(goal, rival["name"]) for goal, rival in chosen_rivals(rivals, ["spz", "sog"])]
    assert found == [(25.0, "a"), (25.0, "d"), (41.0, "b")]


def test_a_file_that_takes_too_long_to_write_is_timed_with_a_quicker_one_and_says_so() -> None:
    sog = next(each for each in formats(scene()) if each.family == "sog")
    assert timed_as(sog, {"encode_seconds": 10.0}) == (sog, "")
    quick, note = timed_as(sog, {"encode_seconds": 4000.0})
    assert "--sh-iterations" in quick.command(Path("a"), Path("b")).words
    assert note


def test_times_are_those_of_the_fastest_reader() -> None:
    found = fastest({"one": {"gsply": {"min": 2.0}, "scar": {"min": 3.0}}})
    assert found == {"one": {"min": 2.0, "reader": "gsply"}}


def test_settings_of_ours_are_options_of_the_encoder() -> None:
    for options in SETTINGS.values():
        EncodeOptions(**options)
    assert not SETTINGS["default"]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "a.scar"
    path.write_bytes(write_scene(random_scene(3, Profile.EXPLICIT)))
    return path


def test_our_reader_is_timed_on_one_core_and_on_all(file: Path) -> None:
    jobs = list(Way(SCAR, "default", 25.0, 1, 25.0, file, 1).jobs())
    assert [cores for cores, *_ in jobs] == ["one", "all"]
    assert read_job({**jobs[1][2]})["walls"]


def test_start_up_is_measured_in_a_process_that_has_imported_nothing(file: Path) -> None:
    command = [sys.executable, "-m", "benchmarks.start_up", SCAR, str(file)]
    found = json.loads(subprocess.run(command, cwd=REPOSITORY, stdout=subprocess.PIPE, check=True).stdout)
    assert set(found) == {"import", "first_more", "open"}
    assert found["import"] > found["open"] > 0


def test_tables_tell_what_is_compared_and_what_is_missing() -> None:
    text = tables([record()])
    assert "| flowers | 41 dB | .scar, archive | below 10 |" in text
    assert ".scar, default, all layers | 125,000 |" in text
    assert "flowers: why." in text
    assert "| flowers | this decoder | 0.50 | 0.10 | 0.0020 |" in text


def test_page_has_the_markers(tmp_path: Path) -> None:
    copy = tmp_path / "page.md"
    copy.write_text(PAGE.read_text(encoding="utf-8"), encoding="utf-8")
    for name in ("crossings", "times", "start-up"):
        replace_section(f"picture-{name}", "text", copy)
    assert copy.read_text(encoding="utf-8").count("\ntext\n") == 3


def test_plots_are_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plots, "SHORT_RESULTS", tmp_path)
    paths = draw([record()], keep=False)
    assert [path.name for path in paths] == ["time-to-picture-flowers.svg"]
    assert paths[0].stat().st_size <= MOST_BYTES
    assert ".scar, default, 25 dB" in paths[0].read_text(encoding="utf-8")


def test_every_scene_measured_was_judged_with_rivals() -> None:
    judged = json.loads((REPOSITORY / "benchmarks" / "results" / "rivals.json").read_text(encoding="utf-8"))
    assert set(QUALITIES) <= set(judged)

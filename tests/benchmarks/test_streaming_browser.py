"""The benchmark in a real browser: what a page noted becomes figures. The browser itself is not started here."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.scaling_scenes import read_scene
from benchmarks.streaming_browser_figures import Log, Picture, by_bytes, figures, simulated
from benchmarks.streaming_browser_tables import tables
from benchmarks.streaming_orders import by_gains, planned_for
from reference_encoder.options import EncodeOptions
from reference_encoder.streaming.told import told
from scarfmt.render.capture import load_cameras
from scarfmt.tools.annotate import with_streaming
from tests.conftest import REPOSITORY
from tests.streaming.test_plan import TOYS


@pytest.fixture(scope="module")
def picture() -> Picture:
    """The scene of the browser package's tests, which has a first view."""
    scene = read_scene(TOYS)
    cameras = load_cameras(REPOSITORY / "examples" / "plush-toys.cameras.json")
    streaming = told(scene, EncodeOptions(cameras=cameras), 2)
    return Picture(with_streaming(TOYS.read_bytes(), streaming), scene, (160, 120))


def noted(drawn: list[tuple[float, int, int]], **more: Any) -> dict[str, Any]:
    """The notes of a page that was requested 1,000 ms after it began."""
    events = [[1000 + at, tile, layer] for at, tile, layer in drawn]
    log = {"click": 1000, "fronts": [1150], "tiles": events, "drawn": events, "done": 9000, "errors": []}
    tasks = [[900, 80, 70], [1100, 60, 20], [1500, 200, 10]]
    stats = {"splatsShown": 7, "evictions": 2}
    return {**log, "tasks": tasks, "mostMemory": 5e6, "stats": stats, **more}


def test_times_are_since_the_scene_was_asked_for() -> None:
    log = Log.of(noted([(10, 0, 1)]))
    assert (log.front, log.done, log.drawn) == (150, 8000, [(10, 0, 1)])
    assert [task[0] for task in log.tasks] == [100, 500], "what the page did before is not told"


@pytest.mark.parametrize("more", [{"errors": ["no"]}, {"done": None}])
def test_a_page_that_failed_gives_no_figures(more: dict[str, Any]) -> None:
    with pytest.raises(RuntimeError):
        Log.of(noted([], **more))


def test_a_plan_followed_at_once_is_told_as_it_was_followed(picture: Picture) -> None:
    """A complete picture is there with the last first layer in view, dB with what is drawn, all with the last tile."""
    steps = by_gains(picture.fetching.index, picture.told, planned_for(picture.camera))
    drawn = [(100.0 * (number + 1), tile, layer) for number, (tile, layer) in enumerate(steps)]
    found = figures(Log.of(noted(drawn)), picture)
    seen = int(picture.seen.sum())
    assert seen > 0
    assert found["complete"] == pytest.approx(0.1 * seen)
    assert found["first"] == pytest.approx(0.1)
    assert found["all"] == pytest.approx(0.1 * len(steps))
    assert (found["task"], found["memory"], found["front"]) == (20, 5.0, 0.15)
    bounds = [found["first"], found["30 dB"], found["35 dB"], found["all"]]
    assert all(value is not None for value in bounds)
    assert bounds == sorted(bounds, key=lambda value: value or 0.0)
    have = [0] * picture.tiles
    for _, tile, layer in drawn[: round(10 * (found["35 dB"] or 0.0))]:
        have[tile] = layer
    assert picture.decibels(have) >= 35


def test_what_never_comes_has_no_time(picture: Picture) -> None:
    found = figures(Log.of(noted([(10, 0, 1)])), picture)
    assert (found["complete"], found["35 dB"], found["all"]) == (None, None, 0.01)


def test_bytes_alone_take_their_time_and_the_round_trips(picture: Picture) -> None:
    fast, slow = by_bytes(picture, 1e9, 50), by_bytes(picture, 1.0, 50)
    assert fast["all"] == pytest.approx(0.1, abs=1e-3)
    assert slow["all"] == pytest.approx(0.1 + 8 * len(TOYS.read_bytes()) / 1e6, rel=0.05)
    assert (slow["complete"] or 0.0) < (slow["all"] or 0.0)


def test_a_simulated_client_takes_no_less_than_bytes_alone(picture: Picture) -> None:
    """On a network without delay as long, all of it; with delay some round trips more."""
    alone, found = by_bytes(picture, 1.0, 0), simulated(picture, 1.0, 0)
    assert found["all"] == pytest.approx(alone["all"], rel=0.03)
    slow = simulated(picture, 1.0, 400)
    assert 0.4 <= (slow["all"] or 0.0) - (found["all"] or 0.0) < 2
    order = [slow[name] or 0.0 for name in ("front", "first", "30 dB", "35 dB", "all")]
    assert order == sorted(order)
    assert order[0] > 0.4


def test_tables_have_a_row_for_each_measure() -> None:
    found = dict.fromkeys(("front", "first", "complete", "30 dB", "35 dB", "all", "task", "memory"), 1.25)
    results = {
        "a": {"runs": 5, "median": found, "least": {**found, "complete": None}},
        "b": {"budget": 24, "bytes": 2e6, "most": 20.0, "splats": 1000, "evictions": 3},
    }
    lines = tables(results).splitlines()
    assert [line.split(" | ")[0] for line in lines if line.startswith(("| a", "| b"))] == [
        "| a, median of 5", "| a, least", "| b"
    ]  # fmt: skip
    assert "–" in lines[3]

"""From what was there when to figures, and from figures to rows of the tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from benchmarks.streaming_clients import WholeFile
from benchmarks.streaming_time_tables import against, image, policies, ratios, times
from benchmarks.streaming_times import LEVELS_DB, MOMENTS, WATCHED_S, figures_of, mean_db, seconds_to, state_at


def test_moments_are_a_quarter_apart_and_include_the_end_of_what_is_watched() -> None:
    """The moments include the end, so that means are taken over the whole time."""
    assert WATCHED_S in MOMENTS.tolist()
    assert (MOMENTS[1:] / MOMENTS[:-1]) == pytest.approx(1.25)


def test_what_is_drawn_is_what_came_last() -> None:
    """At the very moment it counts."""
    shown = [(0.0, "nothing"), (1.0, "a"), (2.0, "b")]
    assert [state_at(shown, at) for at in (0.5, 1.0, 1.9, 3.0)] == ["nothing", "a", "a", "b"]


def test_what_changes_once_is_good_from_then_on() -> None:
    """A change counts from its own moment, not from the one it was seen at. Between two changes values are
    interpolated; a PSNR that is never reached is None."""
    curve = [10.0] * 5 + [40.0] * 5
    low, high = float(MOMENTS[4]), float(MOMENTS[5])
    once = low + 0.3 * (high - low)
    assert seconds_to(30, [(0.0, 0), (once, 1)], curve) == pytest.approx(once)
    twice = [(0.0, 0), (low + 0.2 * (high - low), 1), (low + 0.5 * (high - low), 2)]
    assert seconds_to(25, twice, curve) == pytest.approx(low + 0.35 * (high - low))
    assert seconds_to(41, twice, curve) is None


def test_means_over_time_count_no_more_than_enough() -> None:
    """45 dB, from the click on."""
    assert mean_db([60.0] * 40) == pytest.approx(45)
    assert mean_db([20.0] * 40) == pytest.approx(20)


def test_figures_of_a_whole_file() -> None:
    """A whole file shows nothing and then everything; a view of half of it never exists."""
    client = WholeFile(1000)
    client.asked, client.came = [0.0], [(0.5, None, 600), (2.0, None, 400)]
    client.shown.append((2.0, True))
    found = figures_of(client, lambda _, state: 36.0 if state else 8.0, {None: 0.5})
    assert found["to"] == [2.0, 2.0, 2.0, None]
    assert (found["requests"], found["bytes"], found["unseen"]) == (1, 1000, 500)
    assert 29 < found["mean"] < 32
    assert found["db"][0] == 8
    assert found["db"][-1] == 36


def row(seconds: Sequence[float | None], came: int = 100, unseen: int = 10) -> dict[str, Any]:
    """Figures of one client in one condition."""
    return {"to": seconds, "mean": 33.0, "requests": 3, "bytes": came, "unseen": unseen}


@pytest.fixture
def record() -> dict[str, Any]:
    """A scene on two networks."""
    ours, base, rival = [0.1, 0.2, 0.4, 1.0], [0.2, 0.4, 0.4, 2.0], [1.0, 1.0, 1.0, None]
    others = {name: row(base) for name in ("in view first", "nearest first", "planned, nothing told", "oracle")}
    slow = {"planned by gains": row([1.0, 1.0, 2.0, 8.0]), "whole SOG": row([2.0, 2.0, 2.0, 4.0])}
    names = ("file order", "planned by gains", "whole SOG")
    curve = [10.0] * 18 + [40.0] * 7
    return {
        "sizes": {"`.scar`": 2_000_000, "whole SOG": 6_000_000},
        "networks": {"10 Mbit/s": 200.0, "slow": 1.0},
        "curves": {network: dict.fromkeys(names, curve) for network in ("10 Mbit/s", "slow")},
        "runs": {
            "10 Mbit/s, 20 ms, walk": {"file order": row(base), "planned by gains": row(ours, 100, 0),
                                       **others, "whole SOG": row(rival)},
            "slow, 20 ms, walk": {"file order": row([2.0] * 4), **others, **slow},
        },
    }  # fmt: skip


def test_ratios_count_what_only_one_gets_to(record: dict[str, Any]) -> None:
    """A ratio in which only one client gets there counts as zero or as infinity."""
    level = LEVELS_DB.index(41.0)
    assert list(ratios(record, "planned by gains", "whole SOG", level, True)) == [0]
    assert list(ratios(record, "planned by gains", "whole SOG", level, False)) == [2]
    assert list(ratios(record, "planned by gains", "whole SOG", level)) == [0, 2]
    assert list(ratios(record, "whole SOG", "planned by gains", level)) == [float("inf"), 0.5]


def test_rivals_are_compared_in_each_condition(record: dict[str, Any]) -> None:
    """Five times sooner and twice: a geometric mean of 3.2, once within a quarter of the time."""
    cells = "4.5× | 3.2× | 1.6× | – | 2.0× | 2.0× | 1 of 2 | 0 of 1"
    assert f"| scene | whole SOG | {cells} |" in against({"scene": record})


def test_times_are_means_on_each_network(record: dict[str, Any]) -> None:
    """With what files are, and what of them is never looked at."""
    text = times({"scene": record})
    assert "| scene | planned by gains | 2.00 | 40.0 | 1.00 | 0.20 | 3 | 5 % |" in text
    assert "| scene | whole SOG | 6.00 | 40.0 | 2.00 | 1.00 | 3 | 10 % |" in text


def test_policies_are_set_against_file_order(record: dict[str, Any]) -> None:
    """Mean and worst."""
    text = policies({"scene": record})
    assert "| scene | planned by gains | -50 % | -50 % | +0 % | +300 % | +0 % | +0 % | 33.0 | 3 | 5 % |" in text


def test_images_are_named_by_scenes() -> None:
    """Letters, digits and hyphens."""
    assert image("plush-on-bed, poses") == "streaming-plush-on-bed-poses"

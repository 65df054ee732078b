"""The network that streaming is measured on: known answers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.streaming_network import Flow, Link, Trace


def ended(link: Link, until: float = 100.0) -> dict[object, float]:
    """When each answer that is under way is over, by what was asked for."""
    now = 0.0
    found: dict[object, float] = {}
    while link.flows and now < until:
        flows, now_before = list(link.flows), now
        now = link.next_event(now, until)
        link.advance(now_before, now)
        found |= {flow.tag: now for flow in flows if flow.done}
    return found


def test_an_answer_takes_a_round_trip_and_its_bytes() -> None:
    """8 Mbit/s are a million bytes a second."""
    link = Link(Trace.constant(8), 0.1)
    link.ask(0.0, "one", 500_000)
    assert ended(link) == {"one": pytest.approx(0.6)}


def test_answers_share_what_there_is() -> None:
    """Two of one size asked for together are over together; a small one leaves the rest to the other."""
    link = Link(Trace.constant(8), 0.05)
    link.ask(0.0, "one", 500_000)
    link.ask(0.0, "two", 500_000)
    assert ended(link) == {"one": pytest.approx(1.05), "two": pytest.approx(1.05)}
    link = Link(Trace.constant(8), 0.05)
    link.ask(0.0, "small", 100_000)
    link.ask(0.0, "large", 500_000)
    assert ended(link) == {"small": pytest.approx(0.25), "large": pytest.approx(0.65)}


def test_requests_under_way_together_cost_one_round_trip() -> None:
    """Asked for before the first is over, a second begins where it ends."""
    link = Link(Trace.constant(8), 0.2)
    link.ask(0.0, "one", 100_000)
    link.ask(0.1, "two", 100_000)
    assert ended(link) == {"one": pytest.approx(0.3), "two": pytest.approx(0.4)}


def test_a_trace_changes_with_time_and_begins_again(tmp_path: Path) -> None:
    """A second at 8 Mbit/s, one at 0, one at 16, and so on; the time before the first row does not count."""
    path = tmp_path / "trace"
    path.write_text("5 8\n6 0\n7 16\n")
    trace = Trace.read(path)
    assert trace.length == 3
    assert trace.mean == 8
    link = Link(trace, 0.0)
    link.ask(0.0, "all", 3_500_000)
    assert ended(link) == {"all": pytest.approx(3.5)}


def test_a_trace_of_one_column_has_a_row_a_second(tmp_path: Path) -> None:
    """Recordings of walks have one column and a row for each second."""
    path = tmp_path / "trace.txt"
    path.write_text("8\n16\n")
    trace = Trace.read(path)
    assert trace.starts.tolist() == [0, 1]
    assert trace.at(1.5) == (2_000_000, 2)
    assert trace.at(2.5) == (1_000_000, 3)


def test_marks_are_events() -> None:
    """The client is called at each mark exactly, however bytes were shared before it."""
    link = Link(Trace.constant(8), 0.1)
    flow = link.ask(0.0, "one", 300_000, [100_000, 250_000])
    link.ask(0.0, "two", 70_000)
    now, reached = 0.0, []
    while link.flows:
        until = link.next_event(now, now + 10)
        link.advance(now, until)
        now = until
        reached.append(flow.got)
    assert [size for size in (100_000, 250_000, 300_000) if size in reached] == [100_000, 250_000, 300_000]
    assert now == pytest.approx(0.47)


def test_flows_are_told_apart() -> None:
    """Two that are alike are two."""
    one, two = (Flow("x", 1.0, 0.0, 0.0, [1.0]) for _ in range(2))
    assert one != two
    assert np.isfinite(one.to_mark)

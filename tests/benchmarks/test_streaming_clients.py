"""Clients of the benchmark of streaming: requests as ScarStream makes them, and what there is to draw when."""

from __future__ import annotations

import re
from itertools import takewhile
from typing import cast

import numpy as np
import pytest

from benchmarks import streaming_requests as requests
from benchmarks.scaling_scenes import read_scene, recut
from benchmarks.scenes import REPOSITORY
from benchmarks.streaming_clients import ScarFile, ScarStream, WholeFile, run
from benchmarks.streaming_levels import LevelStream
from benchmarks.streaming_network import Link, Trace
from benchmarks.streaming_orders import Film, planned_for
from benchmarks.streaming_policies import (
    Moment,
    Oracle,
    Order,
    distances,
    file_order,
    in_view_first,
    nearest_first,
    planned,
)
from benchmarks.streaming_requests import Meter, Sizes, next_request
from benchmarks.streaming_rivals import Levels
from scarfmt.container.directory import Entry
from scarfmt.render.viewpoints import Surroundings
from scarfmt.streaming.boxes import tight_boxes
from scarfmt.streaming.plan import Step
from scarfmt.streaming.view import Camera, share_in_picture
from tests.streaming.test_plan import TOYS

ANYWHERE = Camera(np.zeros(3), np.array([1.0, 0, 0]), np.array([0.0, -1, 0]), 0.6, 4, 3)


@pytest.fixture(scope="module")
def file() -> ScarFile:
    """The scene of the browser package's tests."""
    return ScarFile(TOYS.read_bytes())


def camera(file: ScarFile) -> Camera:
    """A camera beside the scene, with a part of it in the picture."""
    boxes = tight_boxes(file.index.cubes, None)
    low, high = boxes.low.min(axis=0), boxes.high.max(axis=0)
    eye = low - np.array([0.1, 0.0, 0.0]) * (high - low)
    return Camera(eye, np.array([1.0, 0.2, 0.2]), np.array([0.0, -1.0, 0.0]), 0.6, 4, 3)


def streamed(file: ScarFile, order: Order, told: bool = False, mbits: float = 2.0) -> ScarStream:
    """A client after it has fetched everything."""
    client = ScarStream(file, order, told)
    run(client, Link(Trace.constant(mbits), 0.05), lambda _: camera(file), 60)
    return client


def test_everything_comes_and_little_else(file: ScarFile) -> None:
    """Each tile once, in about the time the bytes take, whatever the order."""
    for order, told in ((file_order, False), (in_view_first, False), (planned, True)):
        client = streamed(file, order, told)
        assert client.done
        assert client.have.tolist() == [file.index.bytes.shape[1]] * len(file.index.bytes)
        assert sum(size for _, _, size in client.came) == file.index.bytes.sum()
        assert client.shown[-1][0] == pytest.approx(file.size / 250_000, rel=0.2)
        assert [row[0] for row in client.shown] == sorted(row[0] for row in client.shown)


def test_the_front_comes_first_and_alone_tells_what_to_ask_for(file: ScarFile) -> None:
    """Nothing more is asked for before its round trip is over; then at once, without waiting for its end."""
    client = streamed(file, file_order, mbits=2.0)
    assert client.asked[0] == 0
    assert client.asked[1] > 0.05
    assert client.asked[1] <= 0.05 + file.front / 250_000 + 0.02


def test_what_is_in_view_comes_sooner(file: ScarFile, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bytes of tiles in the picture arrive earlier than in file order, those of others later.

    The file is small: with requests of their sizes all but the first would be one.
    """
    monkeypatch.setattr("benchmarks.streaming_clients.FIRST_BYTES", 4096)
    for name, value in (("_LEAST_REQUEST", 2048), ("_MOST_REQUEST", 2048), ("_LEAST_GAP", 0), ("_FIRST_GUESS", 1e4)):
        monkeypatch.setattr(f"benchmarks.streaming_requests.{name}", value)
    seen = share_in_picture(tight_boxes(file.index.cubes, None), camera(file)) > 0
    assert 0 < seen.sum() < len(seen)

    def mean_seconds(client: ScarStream, which: bool) -> float:
        rows = [(seconds, size) for seconds, tile, size in client.came if bool(seen[cast(int, tile)]) is which]
        return sum(seconds * size for seconds, size in rows) / sum(size for _, size in rows)

    first, base = (streamed(file, order, mbits=0.1) for order in (in_view_first, file_order))
    assert mean_seconds(first, True) < mean_seconds(base, True)
    assert mean_seconds(first, False) > mean_seconds(base, False)


def test_the_nearest_tiles_in_view_come_first(file: ScarFile) -> None:
    """Layer by layer, those in view by distance; what is there is not asked for again."""
    moment = Moment(file.index, None, camera(file), 0.0, [1] + [0] * (len(file.index.bytes) - 1))
    boxes = tight_boxes(file.index.cubes, None)
    seen, away = share_in_picture(boxes, moment.camera) > 0, distances(boxes, moment.camera.position)
    steps = [step for step in nearest_first(moment) if seen[step.tile]]
    keys = [(step.layer, away[step.tile]) for step in steps]
    assert keys == sorted(keys)
    assert Step(0, 1) not in steps


def test_a_whole_file_shows_nothing_before_its_end() -> None:
    """One request."""
    client = WholeFile(125_000)
    run(client, Link(Trace.constant(1), 0.1), lambda _: ANYWHERE, 60)
    assert client.asked == [0]
    assert [state for _, state in client.shown] == [False, True]
    assert client.shown[1][0] == pytest.approx(1.1)


def test_levels_of_detail_come_coarsest_first_each_after_its_description() -> None:
    """Index, then meta.json and pictures of the coarsest level, then those of the finest: five round trips."""
    levels = Levels(1000, [(1000, (10_000, 20_000)), (1000, (50_000, 42_000))], [])
    client = LevelStream(levels)
    run(client, Link(Trace.constant(8), 0.1), lambda _: ANYWHERE, 60)
    assert len(client.asked) == 1 + 3 + 3
    assert [state for _, state in client.shown] == [-1, 0, 1]
    assert [seconds for seconds, _ in client.shown] == pytest.approx([0, 0.3 + 0.032, 0.5 + 0.125])
    assert client.done


def entry(offset: int, length: int) -> Entry:
    """A block."""
    return Entry(16, 0, 1, 0, offset, length, 0, 0)


def test_a_request_takes_neighbours_that_are_wanted_soon() -> None:
    """Around the first of the plan, over small gaps, not past the most or what is soon."""
    blocks = [entry(0, 100), entry(110, 100), entry(300, 100), entry(405, 100), entry(600, 5000)]
    sizes = Sizes(window=10_000, most=450, gap=95, under_way=0)
    wanted = [blocks[2], blocks[4], blocks[3], blocks[1], blocks[0]]
    assert next_request(wanted, sizes) == blocks[1:4]
    assert next_request([blocks[4], blocks[3]], sizes) == [blocks[4]]
    assert next_request(wanted, Sizes(150, 450, 95, 0)) == [blocks[2]]


def test_the_meter_counts_while_something_is_under_way() -> None:
    """10 Mbit/s before; then what came in the time, the least delay of the last ones."""
    meter = Meter()
    assert meter.sizes(0.0) == Sizes.of(1.25e6, 0)
    meter.begin(1.0)
    meter.first_byte(0.2)
    meter.first_byte(0.1)
    meter.add(1.01, 1000)
    assert meter.sizes(1.01) == Sizes.of(1.25e6, 0.1)
    meter.add(1.5, 499_000)
    # A million a second on the whole, and five while bytes came.
    assert meter.sizes(1.5) == Sizes.of(4.99e6, 0.1)
    assert meter.sizes(3.6) == Sizes.of(1e6, 0.1)
    assert meter.sizes(3.6).under_way == pytest.approx(325_000)


def test_requests_are_sized_as_the_browser_package_sizes_them() -> None:
    """The numbers of its modules."""
    stream = REPOSITORY / "web" / "src" / "stream"
    text = "".join((stream / name).read_text(encoding="utf-8") for name in ("requests.ts", "meter.ts"))
    named = dict(re.findall(r"const ([A-Z_]+) = ([^;]+);", text))
    for name, value in named.items():
        ours = getattr(requests, name, None) or getattr(requests, f"_{name}")
        assert ours == eval(value), name
    assert len(named) == 12
    opening = (stream / "open_front.ts").read_text(encoding="utf-8")
    assert re.findall(r"firstBytes: ([^,]+), frontBytes", opening) == ["64 * 1024"]
    assert requests.FIRST_BYTES == 64 * 1024


def test_the_oracle_plans_every_step_once_and_first_layers_first(file: ScarFile) -> None:
    """Layer 1 of tiles in the picture, then the rest, those of a tile by layer; of what is there, nothing."""
    scene = recut(read_scene(TOYS), 65536)
    around = Surroundings.of(Film(scene).layers[-1], "-y")
    view = around.camera(around.middle + 0.8 * around.radius * around.direction(0.2, 20), around.middle, "one")
    order = Oracle(scene, file.index, [(0.0, view), (2.0, view)])
    tiles, layers = file.index.bytes.shape
    steps = order(Moment(file.index, None, planned_for(view), 1.5, [0] * tiles))
    assert sorted(steps) == [(tile, layer) for tile in range(tiles) for layer in range(1, layers + 1)]
    behind = share_in_picture(tight_boxes(file.index.cubes, None), planned_for(view), 3.0) == 0
    leading = list(takewhile(lambda step: step.layer == 1, steps))
    assert len(leading) > 2
    assert not any(behind[step.tile] for step in leading[:3])
    for tile in range(tiles):
        assert [step.layer for step in steps if step.tile == tile] == list(range(1, layers + 1))
    rest = order(Moment(file.index, None, planned_for(view), 0.0, [layers - 1] * tiles))
    assert sorted(rest) == [(tile, layers) for tile in range(tiles)]

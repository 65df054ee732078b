"""The benchmark of streaming: motions become views of a scene, orders become curves, curves become bytes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.scaling_scenes import read_scene, recut
from benchmarks.streaming import tables
from benchmarks.streaming_motion import Motion, starts, views
from benchmarks.streaming_orders import ORDERS, Fetching, Film, bytes_to, curve, planned_for
from scarfmt.render.camera import Camera
from scarfmt.render.viewpoints import Surroundings
from tests.streaming.test_plan import TOYS


@pytest.fixture(scope="module")
def film() -> Film:
    """The scene of the browser package's tests."""
    return Film(recut(read_scene(TOYS), 65536))


@pytest.fixture(scope="module")
def view(film: Film, tmp_path_factory: pytest.TempPathFactory) -> Camera:
    """The view at a moment of a recorded motion."""
    path = tmp_path_factory.mktemp("motion") / "walk.csv"
    walk(path)
    around = Surroundings.of(film.layers[-1], "-y")
    (start,) = starts(around, [], 1)
    return views(Motion.read(path), start, around, 2)[1]


def walk(path: Path) -> None:
    """Two metres to the right in four seconds, turning a little to the left."""
    rows = ["t_ms,x,y,z,qx,qy,qz,qw"]
    for step in range(5):
        half = 0.05 * step
        rows.append(f"{1000 * step},{0.5 * step},1.6,0,0,{np.sin(half)},0,{np.cos(half)}")
    path.write_text("\n".join(rows) + "\n")


def test_a_motion_is_read_in_shares_of_its_reach(tmp_path: Path) -> None:
    """From where it began, the farthest place one away; turning left changes the look to the left."""
    walk(tmp_path / "walk.csv")
    motion = Motion.read(tmp_path / "walk.csv")
    assert motion.seconds.tolist() == [0, 1, 2, 3, 4]
    assert motion.places.tolist() == [[0.25 * step, 0, 0] for step in range(5)]
    assert motion.looks[0].tolist() == [0, 0, 0]
    assert motion.looks[4] == pytest.approx([-np.sin(0.4), 0, 1 - np.cos(0.4)])


def test_views_begin_where_they_start_and_look_at_the_scene(film: Film, tmp_path: Path) -> None:
    """Half a radius away at most, to the right of the way to the middle."""
    walk(tmp_path / "walk.csv")
    around = Surroundings.of(film.layers[-1], "-y")
    start = starts(around, [], 3)[1]
    made = views(Motion.read(tmp_path / "walk.csv"), start, around, 2)
    ahead = (around.middle - start) / np.linalg.norm(around.middle - start)
    right = np.cross(ahead, around.axes[2])
    for camera in made:
        moved = camera.centre - start
        assert 0 < np.linalg.norm(moved) <= 0.5 * around.radius + 1e-9
        assert moved @ right > 0.9 * np.linalg.norm(moved)
        assert camera.world_to_camera[2, :3] @ ahead > 0.8


def test_more_bytes_make_the_view_the_one_of_the_whole_file(film: Film, view: Camera) -> None:
    """In every order, at its end; and in view first is no worse than file order halfway."""
    fetching = Fetching(TOYS.read_bytes())
    total = len(TOYS.read_bytes())
    marks, halfway = np.array([0.2, 0.5, 1.02]) * total, {}
    for name, (order, needs) in ORDERS.items():
        steps = order(fetching.index, None, planned_for(view))
        sizes = fetching.sizes(steps, needs)
        assert sizes[-1] <= total
        found = curve(film, view, steps, sizes, marks)
        assert found[-1] == 100
        assert found[0] < found[-1]
        halfway[name] = found[1]
    assert halfway["in view first"] >= halfway["file order"] - 0.5


def test_bytes_are_those_where_a_curve_first_gets_there() -> None:
    """Between marks by a line; the last mark where it never does."""
    marks = np.array([10.0, 20, 30, 40])
    assert bytes_to(35, marks, [30, 34, 36, 33]) == 25
    assert bytes_to(20, marks, [30, 34, 36, 40]) == 10
    assert bytes_to(50, marks, [30, 34, 36, 40]) == 40


def test_the_table_compares_with_file_order() -> None:
    """In per cent."""
    record = {"bytes": 1000, "told": 3, "viewpoints": 1, "tiles": 2, "views": 1,
              "to": {"file order": [1000, 2000, 4000], "planned by gains": [500, 1500, 4000]}}  # fmt: skip
    text = tables({"scene": record})
    assert "| scene | planned by gains | 0 | 2 | 4 | -50 % | -25 % | +0 % |" in text
    assert "0.30 %" in text

"""The benchmark of levels of detail: what is compared has the same budget, and shows what it should."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.detail import PARTS, Subject, tables
from benchmarks.streaming_orders import planned_for
from reference_decoder.scenes.scene_set import open_scene
from scarfmt.render.camera import look_at
from scarfmt.render.metrics import psnr
from tests.streaming.test_plan import TOYS


@pytest.fixture(scope="module")
def subject() -> Subject:
    return Subject(open_scene(TOYS))


def test_all_ways_of_choosing_keep_to_the_budget(subject: Subject) -> None:
    scene = subject.scene.decode()
    middle = np.median(scene.positions, axis=0)
    view = look_at(middle - [0, 0, 3.0], middle, np.array([0, -1.0, 0]), 80, 60, 60.0)
    whole = subject.picture(subject.by_layers(range(len(subject.index.bytes)), subject.total), view)
    for part in PARTS:
        budget = int(part * subject.total)
        for needs in (
            subject.by_view(planned_for(view), budget, subject.told),
            subject.by_view(planned_for(view), budget, None),
            subject.by_layers(range(len(subject.index.bytes)), budget),
        ):
            assert 0 < sum(need.gaussians for need in needs) <= budget
    assert psnr(subject.picture(subject.by_view(planned_for(view), subject.total, None), view), whole) > 40


def test_layers_alone_are_whole_layers_and_then_tiles_in_order(subject: Subject) -> None:
    counts = subject.index.counts
    budget = int(counts[:, 0].sum()) + int(counts[0, 1])
    needs = subject.by_layers(range(len(counts)), budget)
    layers = [need.layers for need in needs]
    assert layers == sorted(layers, reverse=True)
    assert set(layers) == {1, 2}
    assert sum(need.gaussians for need in needs) == budget


def test_a_row_for_each_file_and_way() -> None:
    record = {"gaussians": 10, "tiles": 2, "layers": [4, 10], "views": 1}
    record = {**record, "db": {"a": [1.0] * 4}, "taken": {"a": [1] * 4}}
    text = tables({"toys": record})
    assert "| toys | a | 1.00 |" in text
    assert "4 / 10" in text

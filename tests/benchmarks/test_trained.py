"""Trained files: a bounding curve over the post-hoc files, and photos that a file itself shows."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.photos import Figures, draw, measure_layers
from benchmarks.trained import find_frontier, frontier_bytes
from fuzz.testing.scenes import random_scene
from reference_encoder.training.capture import load_capture
from scarfmt.api import decode_scene, truncate
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from scarfmt.render.camera import look_at
from scarfmt.render.images import write_png
from scarfmt.scene.gaussians import GaussianScene

POINTS = st.lists(st.tuples(st.integers(10, 40).map(float), st.integers(1, 1000).map(float)), min_size=1, max_size=12)


@given(POINTS)
def test_no_point_lies_below_the_frontier_and_it_bends_upwards(points: list[tuple[float, float]]) -> None:
    hull = find_frontier(points)
    assert set(hull) <= set(points)
    decibels, sizes = np.array(hull).T
    slopes = np.diff(np.log(sizes)) / np.diff(decibels)
    assert (np.diff(decibels) > 0).all()
    assert (slopes > 0).all()
    assert (np.diff(slopes) > -1e-9).all()
    for psnr, size in points:
        least = frontier_bytes(hull, max(psnr, decibels[0]))
        assert least is not None
        assert size >= least * (1 - 1e-9)


def test_between_two_points_lies_their_line_and_beyond_them_nothing() -> None:
    hull = find_frontier([(20.0, 100.0), (22.0, 400.0), (21.0, 250.0), (19.0, 120.0)])
    assert hull == [(20.0, 100.0), (22.0, 400.0)]
    assert frontier_bytes(hull, 21.0) == pytest.approx(200.0)
    assert frontier_bytes(hull, 19.9) is None
    assert frontier_bytes(hull, 22.1) is None
    assert frontier_bytes([], 22.1) is None


@pytest.mark.filterwarnings("ignore::scarfmt.errors.InputWarning")
@pytest.mark.parametrize("profile", Profile)
def test_the_last_layer_shows_its_own_photos(profile: Profile, tmp_path: Path) -> None:
    """Exactly, after rounding, which counts as 100 dB; bytes are those of the file cut."""
    data = write_scene(random_scene(4, profile, anchors=80))
    scene, images = decode_scene(data), []
    middle = np.median(scene.positions if isinstance(scene, GaussianScene) else scene.anchors, axis=0)
    (tmp_path / "images").mkdir()
    for number, eye in enumerate(([3.0, 0, 2], [0, 1, 3], [-3, 0, 2], [1, 1, 4])):
        camera = look_at(middle + np.array(eye), middle, np.array([0, -1.0, 0]), 48, 36, name=f"{number}.png")
        write_png(tmp_path / "images" / camera.name, draw(scene, camera))
        pose = {"fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy, "W": 48, "H": 36}
        split = "test" if number % 2 else "train"
        images.append({"name": camera.name, "split": split, **pose, "world_to_camera": camera.world_to_camera.tolist()})
    (tmp_path / "cameras.json").write_text(json.dumps({"images": images}))
    photos = load_capture(tmp_path).test
    rows = list(measure_layers(data, photos, lambda a, b: float(np.abs(a - b).mean())))
    assert len(photos) == 2
    assert [row.file_bytes for row in rows] == [len(truncate(data, number + 1)) for number in range(len(rows))]
    assert (rows[-1].psnr_db, rows[-1].worst_psnr_db, rows[-1].flip) == (100, 100, 0)
    assert rows[-1].ssim == pytest.approx(1)
    assert all(row.psnr_db < 100 for row in rows[:-1])
    assert Figures(1234, 25.0, 24.0, 0.9).cells() == ["1.2", "25.00", "24.00", "0.9000", "–"]

"""Rate and distortion against photos: here photos that the file itself shows."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks import photos
from benchmarks.photos import drawn, figures_table, main
from fuzz.testing.scenes import random_scene
from scarfmt.api import decode_scene, truncate
from scarfmt.arrays import F64
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from scarfmt.render.camera import Camera, look_at
from scarfmt.render.images import write_png
from scarfmt.scene.gaussians import GaussianScene
from tests.benchmarks.test_lpips import pictures, weights

PROFILES = {"explicit": random_scene(4, anchors=80), "anchors": random_scene(3, Profile.ANCHOR)}


def cameras(middle: F64) -> list[Camera]:
    eyes = middle + np.array([[3.0, 0, 2], [0, 1, 3], [-3, 0, 2], [1, 1, 4]])
    return [look_at(eye, middle, np.array([0, -1.0, 0]), 48, 36, name=f"{k}.png") for k, eye in enumerate(eyes)]


def capture(folder: Path, data: bytes) -> Path:
    """A folder of photos that show the whole file, two of them held out."""
    scene = decode_scene(data)
    positions = scene.positions if isinstance(scene, GaussianScene) else scene.anchors
    images = []
    (folder / "images").mkdir(parents=True)
    for number, camera in enumerate(cameras(np.median(positions, axis=0))):
        write_png(folder / "images" / camera.name, drawn(scene, camera))
        pose = {"fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy, "W": 48, "H": 36}
        split = "test" if number % 2 else "train"
        images.append({"name": camera.name, "split": split, **pose, "world_to_camera": camera.world_to_camera.tolist()})
    (folder / "cameras.json").write_text(json.dumps({"images": images}))
    return folder


@pytest.mark.filterwarnings("ignore::scarfmt.errors.InputWarning")
@pytest.mark.parametrize("profile", PROFILES)
def test_the_last_layer_shows_its_own_photos(
    profile: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exactly, after rounding, which counts as 100 dB; bytes are those of the file cut; half of the photos is held out.

    JSON has no infinity: what is written can be read by anything.
    """
    monkeypatch.setattr(photos, "flip_metric", lambda: lambda a, b: float(np.abs(a - b).mean()))
    data = write_scene(PROFILES[profile])
    (tmp_path / "a.scar").write_bytes(data)
    folder = capture(tmp_path / "capture", data)
    main([str(tmp_path / "a.scar"), str(folder), "--json", str(tmp_path / "a.json"), "--beside", "truck"])
    told = json.loads((tmp_path / "a.json").read_text(), parse_constant=pytest.fail)
    rows = told["layers"]
    assert told["photos"] == 2
    assert [row["file_bytes"] for row in rows] == [len(truncate(data, row["layers"])) for row in rows]
    assert rows[-1]["flip"] == 0
    assert rows[-1]["psnr_db"] == rows[-1]["worst_psnr_db"] == 100
    assert rows[-1]["ssim"] == pytest.approx(1)
    assert all(row["psnr_db"] < 100 for row in rows[:-1])
    assert [row["layers"] for row in rows] == list(range(1, len(rows) + 1))
    assert "HAC++ low" in capsys.readouterr().out


def test_a_missing_metric_is_left_out_of_the_table() -> None:
    row = photos.Figures(1234, 25.0, 24.0, 0.9)
    assert figures_table([row]).splitlines()[-1] == "| 1 | 1.2 | 25.00 | 24.00 | 0.9000 | – | – | – |"


def test_lpips_is_measured_where_weights_are_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In both conventions, and without a look for weights elsewhere."""
    torch.save(weights("alexnet"), tmp_path / "a.pt")
    monkeypatch.setattr(photos, "flip_metric", lambda: None)
    assert photos.metrics([]) == {}
    found = photos.metrics([tmp_path / "a.pt"])
    assert sorted(found) == ["lpips", "lpips_3dgs"]
    a, b = pictures()
    assert found["lpips"](a, a) == 0
    assert found["lpips"](a, b) != found["lpips_3dgs"](a, b)

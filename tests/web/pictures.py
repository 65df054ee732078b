"""Pictures of browsers beside those of our renderer."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scarfmt.arrays import F64
from scarfmt.render.camera import Camera
from scarfmt.render.capture import load_cameras
from tests.conftest import REPOSITORY

SCENE = REPOSITORY / "web" / "test" / "data" / "toys.scar"
CAMERAS = REPOSITORY / "examples" / "plush-toys.views.json"
LEAST_PSNR = 40.0
"""Between a browser and our renderer, dB: far above what any compression of a scene costs."""


def run_program(web: Path, chromium: str, *command: str) -> None:
    """Runs a program of web/dist/tests in Node, with a browser."""
    done = subprocess.run(
        ["node", *command],
        cwd=web,
        env={**os.environ, "CHROMIUM": chromium},
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]


def example_camera() -> Camera:
    """A camera of the capture that is close to the toys."""
    return load_cameras(CAMERAS)[2]


def view_of(camera: Camera) -> str:
    """Position, target, up, degrees from top to bottom, as addresses of the page and the programs name a view."""
    forward: F64 = camera.world_to_camera[2, :3]
    upward: F64 = -camera.world_to_camera[1, :3]
    field = math.degrees(2 * math.atan(camera.height / 2 / camera.fy))
    numbers: Sequence[float] = [*camera.centre, *(camera.centre + 4 * forward), *upward, field]
    return ",".join(f"{number:.9g}" for number in numbers)


def difference(camera: Camera, shot: Path, folder: Path) -> float:
    """PSNR between a picture of the scene and our renderer's, dB; `folder` takes what that writes."""
    lens = {"fx": camera.fx, "fy": camera.fy, "cx": camera.width / 2, "cy": camera.height / 2}
    pose = camera.world_to_camera.tolist()
    listed = {"name": "view", "W": camera.width, "H": camera.height, **lens, "world_to_camera": pose}
    cameras = folder / "cameras.json"
    cameras.write_text(json.dumps({"images": [listed]}))
    said = ["render", str(SCENE), str(folder / "ours"), "--cameras", str(cameras), "--quiet"]
    subprocess.run([sys.executable, "-m", "scarfmt", *said], check=True, timeout=300)
    (ours,) = (folder / "ours").glob("*.png")
    error = float(((_picture(shot) - _picture(ours)) ** 2).mean())
    return -10 * math.log10(error)


def _picture(path: Path) -> F64:
    from PIL import Image

    return np.asarray(Image.open(path).convert("RGB"), dtype=np.float64) / 255

"""The viewer page in headless Chromium: what it does, and whether its pictures are those of our renderer."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from scarfmt.arrays import F64
from scarfmt.container.source import FileSource
from scarfmt.render.camera import Camera
from scarfmt.render.capture import load_cameras
from scarfmt.viewer.offered import page_offers, scene_offer
from scarfmt.viewer.server import ViewerServer, page_address
from tests.conftest import REPOSITORY

SCENE = REPOSITORY / "web" / "test" / "data" / "toys.scar"
CAMERAS = REPOSITORY / "examples" / "plush-toys.views.json"
LEAST_PSNR = 40.0
"""Between the page and our renderer, dB: far above what any compression of a scene costs."""


def run(web: Path, chromium: str, *command: str) -> None:
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


def test_the_page_in_a_browser(web: Path, chromium: str) -> None:
    """Draws, refines, obeys keys; keeps the picture when a server cuts, lacks ranges, changes or damages the file."""
    run(web, chromium, "--test", "--test-concurrency=1", "dist/tests/page.browser.mjs")


@pytest.fixture
def address(web: Path) -> Iterator[str]:
    """Of the page with the scene, served as `scarfmt view` does."""
    path, offer = scene_offer(str(SCENE), 0, FileSource(SCENE))
    with ViewerServer({**page_offers(), path: offer}) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield page_address(server.url, [path])
        server.shutdown()
        thread.join()


def _view(camera: Camera) -> str:
    """The part of an address behind # that names the view of a camera."""
    forward: F64 = camera.world_to_camera[2, :3]
    upward: F64 = -camera.world_to_camera[1, :3]
    field = math.degrees(2 * math.atan(camera.height / 2 / camera.fy))
    numbers: Sequence[float] = [*camera.centre, *(camera.centre + 4 * forward), *upward, field]
    return "#view=" + ",".join(f"{number:.9g}" for number in numbers)


def _picture(path: Path) -> F64:
    from PIL import Image

    return np.asarray(Image.open(path).convert("RGB"), dtype=np.float64) / 255


def test_pictures_are_those_of_our_renderer(web: Path, chromium: str, address: str, tmp_path: Path) -> None:
    """Geometry, harmonics, order, blur and what lies beside the picture: nothing of a scene may look otherwise."""
    camera = load_cameras(CAMERAS)[2]
    pose = camera.world_to_camera.tolist()
    lens = {"fx": camera.fx, "fy": camera.fy, "cx": camera.width / 2, "cy": camera.height / 2}
    listed = {"name": "view", "W": camera.width, "H": camera.height, **lens, "world_to_camera": pose}
    cameras = tmp_path / "cameras.json"
    cameras.write_text(json.dumps({"images": [listed]}))
    shot = tmp_path / "shot.png"
    run(web, chromium, "dist/tests/shot.mjs", address + _view(camera), str(shot), str(camera.width), str(camera.height))

    said = ["render", str(SCENE), str(tmp_path / "ours"), "--cameras", str(cameras), "--quiet"]
    subprocess.run([sys.executable, "-m", "scarfmt", *said], check=True, timeout=300)
    (ours,) = (tmp_path / "ours").glob("*.png")
    error = float(((_picture(shot) - _picture(ours)) ** 2).mean())
    assert -10 * math.log10(error) > LEAST_PSNR

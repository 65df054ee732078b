"""The viewer page and the example for PlayCanvas in headless Chromium, and their pictures beside our renderer's."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from scarfmt.arrays import F64
from scarfmt.container.source import FileSource
from scarfmt.render.camera import Camera
from scarfmt.render.capture import load_cameras
from scarfmt.viewer.offers import page_offers, scene_offer
from scarfmt.viewer.server import ViewerServer, page_address
from tests.conftest import REPOSITORY

SCENE = REPOSITORY / "web" / "test" / "data" / "toys.scar"
CAMERAS = REPOSITORY / "examples" / "plush-toys.views.json"
LEAST_PSNR = 40.0
"""Between a browser and our renderer, dB: far above what any compression of a scene costs."""


def run_program(web: Path, chromium: str, *command: str) -> None:
    """Run a program of web/dist/tests in Node, with a browser."""
    environment = {**os.environ, "CHROMIUM": chromium}
    done = subprocess.run(
        ["node", *command], cwd=web, env=environment, capture_output=True, text=True, timeout=900, check=False
    )
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]


@pytest.mark.parametrize("name", ["bundlers", "page", "page_trouble", "playcanvas", "three"])
def test_pages_in_a_browser(web: Path, chromium: str, name: str) -> None:
    """They draw, refine, obey keys and address, hide what is evicted, keep the picture and say what is wrong."""
    run_program(web, chromium, "--test", "--test-concurrency=1", f"dist/tests/{name}.browser.mjs")


@pytest.fixture
def camera() -> Camera:
    """A camera of the capture that is close to the toys."""
    return load_cameras(CAMERAS)[2]


def view_of(camera: Camera) -> str:
    """Position, target, up, degrees from top to bottom, as addresses of the page and the programs name a view."""
    forward: F64 = camera.world_to_camera[2, :3]
    upward: F64 = -camera.world_to_camera[1, :3]
    field = math.degrees(2 * math.atan(camera.height / 2 / camera.fy))
    numbers = [*camera.centre, *(camera.centre + 4 * forward), *upward, field]
    return ",".join(f"{number:.9g}" for number in numbers)


def psnr_of(camera: Camera, shot: Path, folder: Path) -> float:
    """PSNR between a picture of the scene and our renderer's, dB."""
    lens = {"fx": camera.fx, "fy": camera.fy, "cx": camera.width / 2, "cy": camera.height / 2}
    pose = camera.world_to_camera.tolist()
    listed = {"name": "view", "W": camera.width, "H": camera.height, **lens, "world_to_camera": pose}
    cameras = folder / "cameras.json"
    cameras.write_text(json.dumps({"images": [listed]}))
    command = ["render", str(SCENE), str(folder / "ours"), "--cameras", str(cameras), "--quiet"]
    subprocess.run([sys.executable, "-m", "scarfmt", *command], check=True, timeout=300)
    (ours,) = (folder / "ours").glob("*.png")
    return -10 * math.log10(float(((_picture(shot) - _picture(ours)) ** 2).mean()))


def _picture(path: Path) -> F64:
    from PIL import Image

    return np.asarray(Image.open(path).convert("RGB"), dtype=np.float64) / 255


@pytest.fixture
def address(web: Path) -> Iterator[str]:
    """The address of the page with the scene, served as by `scarfmt view`."""
    path, offer = scene_offer(str(SCENE), 0, FileSource(SCENE))
    with ViewerServer({**page_offers(), path: offer}) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield page_address(server.url, [path])
        server.shutdown()
        thread.join()


def test_pictures_of_the_page_are_those_of_our_renderer(
    web: Path, chromium: str, address: str, camera: Camera, tmp_path: Path
) -> None:
    """Geometry, harmonics, order, blur and what lies beside the picture: nothing of a scene may look otherwise."""
    shot = tmp_path / "shot.png"
    page = f"{address}#view={view_of(camera)}"
    run_program(web, chromium, "dist/tests/shot.mjs", page, str(shot), str(camera.width), str(camera.height))
    assert psnr_of(camera, shot, tmp_path) > LEAST_PSNR


def test_an_exported_page_opens_from_a_disk(web: Path, chromium: str, camera: Camera, tmp_path: Path) -> None:
    """It needs no server, and no other file."""
    page, shot = tmp_path / "toys.html", tmp_path / "shot.png"
    subprocess.run([sys.executable, "-m", "scarfmt", "export", str(SCENE), str(page)], check=True, timeout=60)
    address = f"{page.as_uri()}#view={view_of(camera)}"
    run_program(web, chromium, "dist/tests/shot.mjs", address, str(shot), str(camera.width), str(camera.height))
    assert psnr_of(camera, shot, tmp_path) > LEAST_PSNR


@pytest.mark.parametrize("device", ["webgl2", "webgpu"])
def test_pictures_of_playcanvas_are_those_of_our_renderer(
    web: Path, chromium: str, camera: Camera, tmp_path: Path, device: str
) -> None:
    """The shaders that `drawAsTrained` changes are those of the release that is pinned, and the change is right."""
    shot = tmp_path / "shot.png"
    size = [str(camera.width), str(camera.height)]
    run_program(web, chromium, "dist/tests/shot_playcanvas.mjs", str(SCENE), str(shot), *size, view_of(camera), device)
    if device == "webgpu" and not shot.exists():
        pytest.skip("this Chromium has no adapter for WebGPU")
    assert psnr_of(camera, shot, tmp_path) > LEAST_PSNR

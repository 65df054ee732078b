"""Scenes of several files in headless Chromium: as `scarfmt view` serves them, drawn where their index places them."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from reference_decoder.scenes.making import make_index
from scarfmt.arrays import F64
from scarfmt.container.source import FileSource
from scarfmt.render.camera import Camera
from scarfmt.viewer.offered import index_offers, page_offers
from scarfmt.viewer.server import ViewerServer, page_address
from tests.web.pictures import LEAST_PSNR, SCENE, difference, example_camera, run_program, view_of

SCALE = 3.0
ROTATION = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]], dtype=np.float64)
TRANSLATION = np.array([5, -2, 0.5])


@contextmanager
def serving(index: Path) -> Iterator[str]:
    """The address of the page with an index, served as `scarfmt view` does."""
    offers = index_offers(str(index), 0, FileSource(index), lambda name: FileSource(Path(name)))
    with ViewerServer({**page_offers(), **offers}) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield page_address(server.url, [next(iter(offers))])
        server.shutdown()
        thread.join()


def placed(camera: Camera) -> Camera:
    """A camera that sees of a scene that is placed what `camera` sees of it where it is."""
    rotation: F64 = camera.world_to_camera[:3, :3] @ ROTATION.T
    centre: F64 = SCALE * ROTATION @ camera.centre + TRANSLATION
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ centre
    return replace(camera, world_to_camera=pose)


def test_a_scene_of_parts_is_drawn_where_it_is_placed(web: Path, chromium: str, tmp_path: Path) -> None:
    """Two parts, turned, enlarged and moved alike: seen from where that takes the camera, the picture is the same."""
    said = ["split", str(SCENE), str(tmp_path / "part.scar"), "--files", "2", "--quiet"]
    subprocess.run([sys.executable, "-m", "scarfmt", *said], check=True, timeout=300)
    paths = sorted(tmp_path.glob("part-*.scar"))
    rows = np.eye(4)
    rows[:3, :3], rows[:3, 3] = SCALE * ROTATION, TRANSLATION
    index = tmp_path / "toys.scar.json"
    index.write_bytes(make_index(paths, tmp_path, {path.name: rows.tolist() for path in paths}).text())
    camera = example_camera()
    shot = tmp_path / "shot.png"
    with serving(index) as address:
        page = f"{address}#view={view_of(placed(camera))}"
        run_program(web, chromium, "dist/tests/shot.mjs", page, str(shot), str(camera.width), str(camera.height))
    assert len(paths) == 2
    assert difference(camera, shot, tmp_path) > LEAST_PSNR

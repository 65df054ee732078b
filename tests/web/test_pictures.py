"""Whether pictures that browsers draw are those of our renderer: the viewer page, and the adapter for PlayCanvas."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from scarfmt.container.source import FileSource
from scarfmt.viewer.offered import page_offers, scene_offer
from scarfmt.viewer.server import ViewerServer, page_address
from tests.web.pictures import LEAST_PSNR, SCENE, difference, example_camera, run_program, view_of


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


def test_pictures_of_the_page_are_those_of_our_renderer(web: Path, chromium: str, address: str, tmp_path: Path) -> None:
    """Geometry, harmonics, order, blur and what lies beside the picture: nothing of a scene may look otherwise."""
    camera = example_camera()
    shot = tmp_path / "shot.png"
    page = f"{address}#view={view_of(camera)}"
    run_program(web, chromium, "dist/tests/shot.mjs", page, str(shot), str(camera.width), str(camera.height))
    assert difference(camera, shot, tmp_path) > LEAST_PSNR


def test_pictures_of_playcanvas_are_those_of_our_renderer(web: Path, chromium: str, tmp_path: Path) -> None:
    """The shaders that `drawAsTrained` changes are those of the release that is pinned, and the change is right."""
    camera = example_camera()
    shot = tmp_path / "shot.png"
    size = [str(camera.width), str(camera.height)]
    run_program(web, chromium, "dist/tests/shot_playcanvas.mjs", str(SCENE), str(shot), *size, view_of(camera))
    assert difference(camera, shot, tmp_path) > LEAST_PSNR

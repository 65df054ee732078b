"""The viewer page in headless Chromium: what it does, and whether its pictures are those of our renderer."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from scarfmt.container.source import FileSource
from scarfmt.viewer.offered import page_offers, scene_offer
from scarfmt.viewer.server import ViewerServer, page_address
from tests.web.pictures import LEAST_PSNR, SCENE, difference, example_camera, run_program, view_of


def test_the_page_in_a_browser(web: Path, chromium: str) -> None:
    """Draws, refines, obeys keys; keeps the picture when a server cuts, lacks ranges, changes or damages the file."""
    run_program(web, chromium, "--test", "--test-concurrency=1", "dist/tests/page.browser.mjs")


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


def test_pictures_are_those_of_our_renderer(web: Path, chromium: str, address: str, tmp_path: Path) -> None:
    """Geometry, harmonics, order, blur and what lies beside the picture: nothing of a scene may look otherwise."""
    camera = example_camera()
    shot = tmp_path / "shot.png"
    page = f"{address}#view={view_of(camera)}"
    run_program(web, chromium, "dist/tests/shot.mjs", page, str(shot), str(camera.width), str(camera.height))
    assert difference(camera, shot, tmp_path) > LEAST_PSNR

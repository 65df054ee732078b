"""The adapter for PlayCanvas in headless Chromium, by the example page that shows its use."""

from __future__ import annotations

from pathlib import Path

from tests.web.pictures import LEAST_PSNR, SCENE, difference, example_camera, run_program, view_of


def test_the_example_in_a_browser(web: Path, chromium: str) -> None:
    """Draws after the first layer, refines, plans for the camera, hides what is evicted, and leaves nothing behind."""
    run_program(web, chromium, "--test", "--test-concurrency=1", "dist/tests/playcanvas.browser.mjs")


def test_pictures_are_those_of_our_renderer(web: Path, chromium: str, tmp_path: Path) -> None:
    """The shaders that `drawAsTrained` changes are those of the release that is pinned, and the change is right."""
    camera = example_camera()
    shot = tmp_path / "shot.png"
    size = [str(camera.width), str(camera.height)]
    run_program(web, chromium, "dist/tests/shot_playcanvas.mjs", str(SCENE), str(shot), *size, view_of(camera))
    assert difference(camera, shot, tmp_path) > LEAST_PSNR


def test_the_example_is_short(web: Path) -> None:
    """It is what people read first, and the README says how long it is."""
    lines = (web / "examples" / "playcanvas.html").read_text().splitlines()
    assert len([line for line in lines if line.strip()]) < 40

"""The adapter for PlayCanvas in headless Chromium, by the example page that shows its use."""

from __future__ import annotations

from pathlib import Path

from tests.web.pictures import run_program


def test_the_example_in_a_browser(web: Path, chromium: str) -> None:
    """Draws after the first layer, refines, plans for the camera, hides what is evicted, and leaves nothing behind."""
    run_program(web, chromium, "--test", "--test-concurrency=1", "dist/tests/playcanvas.browser.mjs")


def test_the_example_is_short(web: Path) -> None:
    """People read the example first, and the README gives its length."""
    lines = (web / "examples" / "playcanvas.html").read_text().splitlines()
    assert len([line for line in lines if line.strip()]) < 40

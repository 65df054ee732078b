"""The viewer page in headless Chromium, where something is wrong; runs beside test_page, being a file of its own."""

from __future__ import annotations

from pathlib import Path

from tests.web.pictures import run_program


def test_the_page_in_trouble(web: Path, chromium: str) -> None:
    """Keeps the picture when a server cuts, changes or damages the file, and says what is no scene."""
    run_program(web, chromium, "--test", "--test-concurrency=1", "dist/tests/page_trouble.browser.mjs")

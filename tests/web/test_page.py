"""The viewer page in headless Chromium: what it does."""

from __future__ import annotations

from pathlib import Path

from tests.web.pictures import run_program


def test_the_page_in_a_browser(web: Path, chromium: str) -> None:
    """Draws, refines, obeys keys and its address, loads what it needs in an order that helps."""
    run_program(web, chromium, "--test", "--test-concurrency=1", "dist/tests/page.browser.mjs")

"""The conformance suite for both decoders of the browser package, in a browser."""

from __future__ import annotations

import re
import subprocess
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY

VECTORS_AT_LEAST = 700
FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=600000", "--dump-dom")
"""Virtual time stands still while the page works or waits for an answer: it is dumped when all is done."""


class Quiet(SimpleHTTPRequestHandler):
    """Serves files, and says nothing of it."""

    def log_message(self, format: str, *args: object) -> None:
        """Nothing."""


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """A server of the repository on this machine."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(REPOSITORY)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    server.server_close()


@pytest.mark.slow
@pytest.mark.parametrize("decoder", ["js", "wasm"])
def test_vectors_in_a_browser(web: Path, chromium: str, address: str, decoder: str) -> None:
    """A browser's engine is not Node's: what a viewer decodes is what the format says there too."""
    if decoder == "wasm" and not (web / "dist" / "scar.wasm").exists():
        pytest.skip("web/dist/scar.wasm is not built: clang-14 and lld-14 are missing")
    page = f"{address}/web/test/suite.html?decoder={decoder}"
    text = subprocess.run([chromium, *FLAGS, page], capture_output=True, text=True, timeout=300, check=True).stdout
    found = re.search(r"Done: (\d+) of (\d+) vectors pass", text)
    assert found is not None, text[-2000:]
    passed, asked = int(found[1]), int(found[2])
    assert passed == asked, re.findall(r"<li>([^<]*)", text)
    assert asked >= VECTORS_AT_LEAST

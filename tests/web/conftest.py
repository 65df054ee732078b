"""The browser package, built from its sources as they are now; its tests are skipped where that cannot be done."""

from __future__ import annotations

import fcntl
import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY

WEB = REPOSITORY / "web"
BUILT = WEB / "dist" / "scar-stream.js"
SUFFIXES = (".ts", ".mjs", ".c", ".h", ".sh", ".html", ".css")


def _missing() -> str | None:
    """The requirement of these tests that is missing."""
    if shutil.which("node") is None:
        return "there is no node on the path"
    if not (WEB / "node_modules").is_dir():
        return "web/node_modules is missing: make web"
    if importlib.util.find_spec("ziglang") is None:
        return "ziglang is missing: make web"
    return None


def _is_current() -> bool:
    """Whether `web/dist` is newer than its sources."""
    folders = [*(WEB / name for name in ("src", "test", "viewer")), REPOSITORY / "scarfmt" / "native"]
    files = [path for folder in folders for path in folder.rglob("*") if path.suffix in SUFFIXES]
    files += [path for pattern in ("*.mjs", "*.sh", "*.json") for path in WEB.glob(pattern)]
    return BUILT.exists() and BUILT.stat().st_mtime >= max(path.stat().st_mtime for path in files)


@pytest.fixture(scope="session")
def web() -> Path:
    """`web/`, built anew where its sources changed."""
    lacking = _missing()
    if lacking is not None:
        pytest.skip(lacking)
    # Several processes may run tests at once; one of them builds.
    with (WEB / "node_modules" / ".building").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not _is_current():
            environment = {**os.environ, "PYTHON": sys.executable}
            subprocess.run(["npm", "run", "--silent", "build"], cwd=WEB, env=environment, timeout=300, check=True)
    return WEB


@pytest.fixture(scope="session")
def chromium() -> str:
    """A Chromium; the test is skipped where there is none."""
    found = [path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))]
    if not found:
        pytest.skip("there is no Chromium on the path")
    return found[0]

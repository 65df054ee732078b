"""The browser package, built as its sources are now, and why its tests are skipped where that cannot be."""

from __future__ import annotations

import fcntl
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY

WEB = REPOSITORY / "web"
BUILT = WEB / "dist" / "scar-stream.js"
LEAST_NODE = 20
SUFFIXES = (".ts", ".js", ".mjs", ".c", ".h", ".sh", ".html", ".css")


def missing() -> str | None:
    """The requirements of these tests that are missing, None if nothing."""
    node = shutil.which("node")
    if node is None:
        return "there is no node on the path"
    version = subprocess.run([node, "--version"], capture_output=True, text=True, check=False).stdout
    match = re.match(r"v(\d+)\.", version)
    if match is None or int(match[1]) < LEAST_NODE:
        return f"node is {version.strip()}, {LEAST_NODE} is needed"
    if not (WEB / "node_modules").is_dir():
        return "web/node_modules is missing: make web"
    return None


def newest_source() -> float:
    """Time of the last change of what web/dist is built from, seconds."""
    folders = [WEB / name for name in ("src", "test", "viewer", "wasm")]
    folders.append(REPOSITORY / "conformance" / "decoders" / "js")
    files = [path for folder in folders for path in folder.rglob("*") if path.suffix in SUFFIXES]
    files += (REPOSITORY / "scarfmt" / "kernel").glob("*.[ch]")
    return max(path.stat().st_mtime for path in [*files, *WEB.glob("*.mjs"), WEB / "package-lock.json"])


def is_current() -> bool:
    return BUILT.exists() and BUILT.stat().st_mtime >= newest_source()


@pytest.fixture(scope="session")
def web() -> Path:
    """web/, built anew where its sources changed; the test is skipped where it cannot be built."""
    lacking = missing()
    if lacking is not None:
        pytest.skip(lacking)
    # Several processes may run tests at once; one of them builds.
    with (WEB / "node_modules" / ".building").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not is_current():
            subprocess.run(["npm", "run", "--silent", "build"], cwd=WEB, timeout=300, check=True)
    return WEB


@pytest.fixture(scope="session")
def chromium() -> str:
    """A Chromium; the test is skipped where there is none."""
    found = [path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))]
    if not found:
        pytest.skip("there is no Chromium on the path")
    return found[0]

"""A release of the last commit, built once for all tests that look at it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from release.build import build
from tests.conftest import REPOSITORY


@pytest.fixture(scope="session")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that `make dist` makes."""
    out = tmp_path_factory.mktemp("release") / "dist"
    build("HEAD", out)
    return out


def environment(folder: Path, *requirements: str | Path) -> Path:
    """The programs of a new environment with these installed, by their folder."""
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    run([folder / "bin" / "python", "-m", "pip", "install", "--quiet", *requirements])
    return folder / "bin"


def run(command: Sequence[str | Path], folder: Path = REPOSITORY) -> str:
    """The output of a command, run where its folder imports nothing of this repository."""
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(command, cwd=folder, env=clean, check=True, stdout=subprocess.PIPE, text=True).stdout

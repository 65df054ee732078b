"""Scene files, and ways to run the command."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from fuzz.testing.scenes import random_scene
from scarfmt.cli import cli
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from scarfmt.scene.gaussians import GaussianScene
from tests.formats.scene_files import scene_ply

REPOSITORY = Path(__file__).resolve().parents[2]

Run = Callable[..., Result]
Shell = Callable[..., subprocess.CompletedProcess[bytes]]


@pytest.fixture
def run() -> Run:
    """Call the command in this process: run("inspect", path, input=b"...")."""

    def call(*arguments: object, input: bytes | None = None) -> Result:
        return CliRunner().invoke(cli, [str(argument) for argument in arguments], input=input)

    return call


@pytest.fixture
def shell() -> Shell:
    """Run the command in a process of its own, in another directory."""

    def call(*arguments: object, cwd: Path, input: bytes | None = None) -> subprocess.CompletedProcess[bytes]:
        return subprocess.run(
            [sys.executable, "-m", "scarfmt", *map(str, arguments)],
            cwd=cwd,
            input=input,
            capture_output=True,
            env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
            check=False,
            timeout=120,
        )

    return call


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scenes")


@pytest.fixture(scope="session")
def explicit_scar(folder: Path) -> Path:
    """Three layers, explicit profile."""
    path = folder / "explicit.scar"
    path.write_bytes(write_scene(random_scene(1, Profile.EXPLICIT)))
    return path


@pytest.fixture(scope="session")
def anchor_scar(folder: Path) -> Path:
    """Three layers, anchor profile."""
    path = folder / "anchor.scar"
    path.write_bytes(write_scene(random_scene(1, Profile.ANCHOR)))
    return path


def gaussians(count: int) -> GaussianScene:
    """A ball of Gaussians that shows in a picture."""
    rng = np.random.default_rng(0)
    return GaussianScene(
        rng.normal(size=(count, 3)),
        rng.normal(-2.5, 0.5, (count, 3)).astype(np.float32),
        rng.normal(size=(count, 4)).astype(np.float32),
        rng.normal(1.0, 2.0, count).astype(np.float32),
        rng.normal(0.0, 0.5, (count, 4, 3)).astype(np.float32),
    )


@pytest.fixture(scope="session")
def ply(folder: Path) -> Path:
    """An uncompressed scene, SH degree 1."""
    path = folder / "scene.ply"
    path.write_bytes(scene_ply(gaussians(300)))
    return path


@pytest.fixture(scope="session")
def encoded(folder: Path, ply: Path) -> Path:
    """`ply`, encoded fast."""
    path = folder / "encoded.scar"
    arguments = ["encode", str(ply), str(path), "--effort", "1", "--layers", "2", "--quality", "35", "-q"]
    result = CliRunner().invoke(cli, arguments)
    assert result.exit_code == 0, result.output
    return path

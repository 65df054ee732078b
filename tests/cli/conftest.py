"""Scene files, and ways to run the command."""

from __future__ import annotations

import os
import subprocess
import sys
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

def run(*arguments: object, input: bytes | None = None) -> Result:
    """Call the command in this process: run("inspect", path, input=b"...")."""
    return CliRunner().invoke(cli, [str(argument) for argument in arguments], input=input)


def python(*said: object, cwd: Path = REPOSITORY, input: bytes | None = None) -> subprocess.CompletedProcess[bytes]:
    """Run Python in a process of its own that finds the packages here."""
    command, env = [sys.executable, *map(str, said)], {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    return subprocess.run(command, cwd=cwd, input=input, capture_output=True, env=env, check=False, timeout=300)


def shell(*arguments: object, cwd: Path, input: bytes | None = None) -> subprocess.CompletedProcess[bytes]:
    """Run the command in a process of its own, in another directory."""
    return python("-m", "scarfmt", *arguments, cwd=cwd, input=input)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scenes")


@pytest.fixture(scope="session")
def explicit_scar(folder: Path) -> Path:
    """Three layers, explicit profile."""
    path = folder / "explicit.scar"
    path.write_bytes(write_scene(random_scene(1, Profile.EXPLICIT)))
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
    result = run("encode", ply, path, "--effort", 1, "--layers", 2, "--quality", 35, "-q")
    assert result.exit_code == 0, result.output
    return path

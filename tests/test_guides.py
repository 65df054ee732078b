"""Commands of the guides run: a newcomer pastes them, and none may have gone or changed its name."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from scarfmt.formats import load
from scarfmt.formats.export_ply import write_inria_ply
from scarfmt.scene.gaussians import GaussianScene
from tests.conftest import REPOSITORY

SHELL = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)
PYTHON = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
LONG = {"photos"}
"""Guides whose commands take a minute, however few Gaussians there are."""
GUIDES = [
    pytest.param(guide, id=guide.stem, marks=[pytest.mark.slow] if guide.stem in LONG else [])
    for guide in sorted((REPOSITORY / "docs" / "guide").glob("*.md"))
]
FEW = 400
QUICK = {"encode": "--effort 1 --corrections 0", "train": "--iterations 4 --resolution 40"}
"""Options added to commands that would take minutes. Of an option given twice, the last counts."""


@pytest.fixture(scope="module")
def examples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the example scene, with fewer Gaussians: the commands are the same, and take seconds."""
    folder = tmp_path_factory.mktemp("guides") / "examples"
    shutil.copytree(REPOSITORY / "examples", folder)
    scene = load(folder / "plush-toys.ply")
    assert isinstance(scene, GaussianScene)
    with (folder / "plush-toys.ply").open("wb") as target:
        write_inria_ply(scene.take(np.arange(0, len(scene), len(scene) // FEW)), target)
    return folder


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Variables with which `scarfmt` is this checkout's command, in a hurry, and `python3` this Python."""
    commands = tmp_path / "bin"
    commands.mkdir()
    python = shlex.quote(sys.executable)
    hurry = "".join(f'{name}) set -- "$@" {options};; ' for name, options in QUICK.items())
    for name, line in (
        ("scarfmt", f'case "$1" in {hurry}esac; exec {python} -m scarfmt "$@"'),
        ("python3", f'exec {python} "$@"'),
    ):
        (commands / name).write_text(f"#!/bin/sh\n{line}\n", encoding="utf-8")
        (commands / name).chmod(0o755)
    paths = [str(REPOSITORY), str(REPOSITORY / "conformance" / "suite")]
    return {**os.environ, "PATH": f"{commands}:{os.environ['PATH']}", "PYTHONPATH": os.pathsep.join(paths)}


@pytest.mark.parametrize("guide", GUIDES)
def test_commands_of_a_guide_run(guide: Path, examples: Path, environment: dict[str, str], tmp_path: Path) -> None:
    """In their order, in an empty folder beside `examples/`; a program that a guide shows is saved as `mine.py`."""
    text = guide.read_text(encoding="utf-8")
    script = "".join(SHELL.findall(text))
    assert "scarfmt " in script
    folder = tmp_path / "work"
    folder.mkdir()
    (folder / "examples").symlink_to(examples)
    for program in PYTHON.findall(text):
        (folder / "mine.py").write_text(program, encoding="utf-8")
    done = subprocess.run(["sh", "-eu"], input=script, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr

"""Pages for readers: links lead somewhere, generated parts are current, and printed commands and programs run.

Decision records are history: what they name may be gone, so they are not looked at.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np
import pytest

from docs.generate import commands, pages
from reference_encoder.encode import encode
from reference_encoder.options import EncodeOptions
from release.first_hour import INSTALL, PYTHON, script_of
from scarfmt.formats import load
from scarfmt.scene.gaussians import GaussianScene
from tests.conftest import REPOSITORY
from tests.formats.scene_files import scene_ply

FOLDERS = (".", "docs", "examples", "conformance", "web", "fuzz")
PAGES = [page for folder in FOLDERS for page in sorted((REPOSITORY / folder).glob("*.md"))]
RUN = {"compress.md": "", "train.md": "slow", "web-page.md": "", "write-a-decoder.md": ""}
"""Guides whose `sh` blocks run, in an empty folder beside `examples/`; those marked slow take a minute."""
QUICK = {"encode": "--effort 1 --corrections 0", "train": "--iterations 4 --resolution 40"}
"""Options added to commands that would take minutes. Of an option given twice, the last counts."""
FEW = 400
BLOCK = re.compile(r"^(?:    (?!$)[^\n]*\n)+|^```(?:sh)?\n(.*?)^```", re.MULTILINE | re.DOTALL)
RUNS_ALONE = [REPOSITORY / name for name in ("README.md", "docs/api.md", "docs/large-scenes.md")]
"""Pages whose Python blocks run beside `scene.ply` and `scene.scar`; other pages show programs to save."""


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def slug(heading: str) -> str:
    """The anchor that GitHub gives a heading."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def broken_links(page: Path) -> list[str]:
    """Relative links of `page` whose file, or whose heading in that file, does not exist."""
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", text_of(page)):
        path, _, anchor = target.partition("#")
        found = (page.parent / path).resolve() if path else page
        if "://" in target:
            continue
        if not found.exists() or (anchor and anchor not in map(slug, re.findall(r"^#+ (.*)$", text_of(found), re.M))):
            broken.append(target)
    return broken


def printed_commands(text: str) -> Iterator[list[str]]:
    """Words of each `scarfmt` command in the indented and `sh` blocks of a page."""
    for match in BLOCK.finditer(text):
        for line in (match[1] or match[0]).replace("\\\n", " ").splitlines():
            for part in re.split(r"[;|&]+|\bdo\b|\buntil\b", line.partition(" #")[0]):
                words = shlex.split(part) if part.count("'") % 2 == 0 else []
                if words[:1] == ["scarfmt"] and len(words) > 1:
                    yield words


def unknown_options(words: list[str]) -> list[str]:
    """Options of a printed command that the command does not have; the command itself where there is none."""
    known = dict(commands())
    name = " ".join(words[:3]) if " ".join(words[:3]) in known else " ".join(words[:2])
    if words[1].startswith("-"):
        name = "scarfmt"
    if name not in known:
        return [name]
    options = {one for parameter in known[name].params for one in (*parameter.opts, *parameter.secondary_opts)}
    options |= {"--help", "-h"}
    given = [word.partition("=")[0] for word in words if re.match(r"--[a-z]|-[a-z]$", word)]
    return [one for one in given if one not in options]


def test_links_lead_somewhere(tmp_path: Path) -> None:
    """Every relative link names a file, and its anchor a heading of that file."""
    (tmp_path / "page.md").write_text("# A b\n[x](#a-b) [y](#c) [z](gone.md) [w](https://a.example)\n")
    assert broken_links(tmp_path / "page.md") == ["#c", "gone.md"]
    assert {str(page): found for page in PAGES if (found := broken_links(page))} == {}


def test_images_are_shown() -> None:
    """A picture that no page shows is left behind."""
    shown = "".join(text_of(page) for page in (*PAGES, *(REPOSITORY / "docs" / "decisions").glob("*.md")))
    assert [path.name for path in (REPOSITORY / "docs" / "images").iterdir() if path.name not in shown] == []


def test_generated_pages_are_current() -> None:
    """`python -m docs.generate` writes them from the code."""
    assert [path.name for path, text in pages().items() if text_of(path) != text] == []


def test_printed_commands_have_the_options_they_name() -> None:
    assert unknown_options(["scarfmt", "encode", "a.ply", "--qualty", "3"]) == ["--qualty"]
    assert unknown_options(["scarfmt", "enkode", "a.ply"]) == ["scarfmt enkode"]
    printed = [(page.name, words) for page in PAGES for words in printed_commands(text_of(page))]
    assert len(printed) > 40
    assert [(page, words, wrong) for page, words in printed if (wrong := unknown_options(words))] == []
    assert all(isinstance(command, click.Command) for _, command in commands())


def few_gaussians() -> GaussianScene:
    """Some Gaussians of the example scene: with them commands take seconds."""
    scene = load(REPOSITORY / "examples" / "plush-toys.ply")
    assert isinstance(scene, GaussianScene)
    return scene.take(np.arange(0, len(scene), len(scene) // FEW))


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `scene.ply`, and with `scene.scar` made of it."""
    folder = tmp_path_factory.mktemp("scenes")
    (folder / "scene.ply").write_bytes(scene_ply(few_gaussians()))
    (folder / "scene.scar").write_bytes(encode(few_gaussians(), EncodeOptions(effort=1, corrections=0, layers=3)))
    return folder


def test_programs_run(scenes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Python examples of a page run one after the other, in one namespace."""
    monkeypatch.chdir(scenes)
    for page in RUNS_ALONE:
        namespace: dict[str, object] = {}
        blocks = list(PYTHON.finditer(text_of(page)))
        assert blocks
        for block in blocks:
            lines_before = text_of(page).count("\n", 0, block.start(1))
            exec(compile("\n" * lines_before + block[1], str(page), "exec"), namespace)


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Variables with which `scarfmt` is this checkout's command, in a hurry, and `python3` this Python."""
    folder = tmp_path / "bin"
    folder.mkdir()
    python = shlex.quote(sys.executable)
    hurry = "".join(f'{name}) set -- "$@" {options};; ' for name, options in QUICK.items())
    for name, line in (
        ("scarfmt", f'case "$1" in {hurry}esac; exec {python} -m scarfmt "$@"'),
        ("python3", f'exec {python} "$@"'),
    ):
        (folder / name).write_text(f"#!/bin/sh\n{line}\n", encoding="utf-8")
        (folder / name).chmod(0o755)
    paths = [str(REPOSITORY), str(REPOSITORY / "conformance" / "suite")]
    return {**os.environ, "PATH": f"{folder}:{os.environ['PATH']}", "PYTHONPATH": os.pathsep.join(paths)}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if slow else []) for name, slow in RUN.items()]
)
def test_commands_of_a_guide_run(name: str, environment: dict[str, str], tmp_path: Path) -> None:
    """A newcomer pastes them in their order; a program that a guide shows is saved as `mine.py`."""
    text = text_of(REPOSITORY / "docs" / name)
    script = INSTALL.sub("", script_of(text))
    assert "scarfmt " in script
    folder = tmp_path / "work"
    folder.mkdir()
    shutil.copytree(REPOSITORY / "examples", folder / "examples")
    (folder / "examples" / "plush-toys.ply").write_bytes(scene_ply(few_gaussians()))
    for program in PYTHON.findall(text):
        (folder / "mine.py").write_text(program, encoding="utf-8")
    done = subprocess.run(["sh", "-eu"], input=script, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr

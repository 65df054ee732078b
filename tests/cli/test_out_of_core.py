"""encode --work: options that go together, its messages, and the file."""

from __future__ import annotations

from pathlib import Path

import fsspec
import pytest

from scarfmt.cli import out_of_core
from scarfmt.container.file import Container
from scarfmt.container.source import BytesSource
from tests.cli.conftest import run

FAST = ("--effort", 1, "--layers", 1, "--quality", 30, "--corrections", 0)


def test_a_scene_is_encoded_in_a_directory_and_not_a_second_time(ply: Path, tmp_path: Path) -> None:
    """Unless gone on with, which finds everything done; another plan is refused."""
    command = ("encode", ply, tmp_path / "a.scar", "--work", tmp_path / "work", *FAST)
    result = run(*command)
    assert result.exit_code == 0, result.output
    data = (tmp_path / "a.scar").read_bytes()
    header = Container(BytesSource(data)).header
    assert (header.fields.source_count, header.layer_count) == (300, 1)
    assert "300 Gaussians in" in result.stderr
    assert "looks like the source" in result.stderr
    again = run(*command, "--force")
    assert (again.exit_code, "work-exists" in again.stderr) == (2, True)
    other = run(*command, "--force", "--resume", "--seed", 5)
    assert (other.exit_code, "work-plan" in other.stderr) == (2, True)
    quiet = run(*command, "--force", "--resume", "--quiet")
    assert (quiet.exit_code, quiet.output) == (0, "")
    assert (tmp_path / "a.scar").read_bytes() == data


def test_a_scene_at_a_url_goes_to_a_url(ply: Path) -> None:
    """Through directories at one: everything is asked of fsspec."""
    system = fsspec.filesystem("memory")
    system.pipe("/cli/scene.ply", ply.read_bytes())
    command = ("encode", "memory://cli/scene.ply", "memory://cli/a.scar", "--work", "memory://cli/work", *FAST, "-q")
    assert run(*command).exit_code == 0
    assert system.cat("/cli/a.scar")[1:5] == b"SCAR"
    assert "output-exists" in run(*command, "--resume").stderr


def test_large_scenes_in_memory_are_advised_against(ply: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before they take the memory that they take; small ones are not."""
    for most, said in ((300, False), (299, True)):
        monkeypatch.setattr(out_of_core, "LARGE_SCENE", most)
        result = run("encode", ply, tmp_path / f"{most}.scar", *FAST)
        assert result.exit_code == 0
        assert ("--work DIR encodes them in ranges" in result.stderr) == said

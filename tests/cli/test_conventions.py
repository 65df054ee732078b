"""Shared properties of all subcommands: exit codes, where output goes, nothing half-written, a quick start."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest

from scarfmt import __version__
from scarfmt.cli import cli
from scarfmt.cli.completion import completion
from scarfmt.cli.failures import FailureGroup, requires_extra
from scarfmt.cli.files import open_output
from scarfmt.engines import described
from scarfmt.errors import InvalidInput
from tests.cli.conftest import REPOSITORY, Run, Shell

HEAVY = ("torch", "numba", "scipy", "plyfile", "fsspec", "aiohttp", "rich", "PIL")


def test_version(run: Run) -> None:
    first, second = run("--version").stdout.splitlines()
    assert __version__ in first
    assert second == f"engine: {described()}"


@pytest.mark.parametrize("name", sorted(cli.commands))
def test_every_help_text_gives_examples_that_name_the_command(run: Run, name: str) -> None:
    result = run(name, "--help")
    assert result.exit_code == 0
    assert f"scarfmt {name}" in result.stdout.partition("Examples:")[2]
    assert not cli.commands[name].get_short_help_str(100).endswith("...")


@pytest.mark.parametrize("name", sorted(cli.commands))
def test_every_option_is_explained(name: str) -> None:
    for parameter in cli.commands[name].params:
        if isinstance(parameter, click.Option):
            assert parameter.help


@pytest.mark.parametrize("arguments", [["--help"], ["inspect", "FILE"], ["encode", "--help"], ["train", "--help"]])
def test_heavy_packages_are_not_imported_by_light_commands(explicit_scar: Path, arguments: list[str]) -> None:
    arguments = [str(explicit_scar) if argument == "FILE" else argument for argument in arguments]
    script = (
        f"import sys; from scarfmt.cli import cli; cli({arguments!r}, standalone_mode=False);"
        f"print('LOADED', [name for name in {HEAVY!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    assert "LOADED []" in done.stdout


def test_help_does_not_even_import_numpy() -> None:
    script = "import sys; from scarfmt.cli import cli; cli(['-h'], standalone_mode=False); print(list(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    assert "'click'" in done.stdout
    assert "'numpy'" not in done.stdout


def test_an_invalid_file_is_one_line_on_stderr_and_exit_code_1(shell: Shell, tmp_path: Path) -> None:
    (tmp_path / "bad.scar").write_bytes(b"no scene at all")
    done = shell("inspect", "bad.scar", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout == b""
    assert re.fullmatch(rb"scarfmt: error: bad-signature: .*\(signature, byte 0\)\r?\n", done.stderr)


def test_a_missing_file_is_exit_code_1(run: Run, tmp_path: Path) -> None:
    result = run("inspect", tmp_path / "none.scar")
    assert (result.exit_code, result.stdout) == (1, "")
    assert "scarfmt: error: input-source: cannot open" in result.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ["inspect"],
        ["inspect", "FILE", "--nonsense"],
        ["truncate", "FILE", "OUT", "--layers", "0"],
        ["truncate", "FILE", "OUT", "--layers", "9"],
        ["truncate", "FILE", "FILE", "--layers", "1"],
        ["truncate", "FILE", "no/such/folder/out.scar", "--layers", "1"],
        ["split", "FILE", "OUT"],
        ["split", "FILE", "OUT", "--files", "1"],
        ["split", "FILE", "OUT", "--files", "999"],
        ["split", "FILE", "OUT", "--files", "2", "--rest", "FILE"],
        ["split", "FILE", "-", "--files", "2"],
        ["merge", "-o", "OUT"],
        ["merge", "FILE"],
        ["validate", "FILE", "--layers", "9"],
        ["encode", "FILE", "OUT", "--metadata", "text"],
        ["encode", "FILE", "OUT", "--quality", "500"],
        ["encode", "FILE", "OUT", "--only-cameras"],
        ["train", "FILE", "OUT", "--minutes", "1", "--iterations", "5"],
        ["train", "FILE", "OUT", "--minutes", "0"],
        ["train", "FILE", "OUT", "--hold-out", "1"],
        ["train", "FILE", "OUT", "--lambda", "1e9"],
        ["train", "FILE", "OUT", "--run", "FILE"],
        ["train", "FILE", "-", "--json"],
        ["train", "FILE", "FILE"],
        ["compare", "FILE", "FILE", "--cameras", "FILE", "--from", "near"],
        ["compare", "FILE", "FILE", "--size", "640"],
        ["compare", "FILE", "FILE", "--size", "0x480"],
        ["compare", "FILE", "FILE", "--all-layers", "--layers-b", "1"],
        ["compare", "FILE", "FILE", "--photos", "/", "--views", "3"],
        ["render", "FILE", "OUT", "--layers", "some"],
        ["decode", "FILE", "out.obj"],
        ["decode", "FILE", "out.ply", "--box", "1,2,3"],
        ["decode", "FILE", "out.ply", "--tiles", "one"],
        ["decode", "FILE", "out.ply", "--layers", "9"],
        ["decode", "FILE", "out.ply", "--spz-version", "3"],
        ["decode", "FILE", "out.spz", "--spz-sh-bits", "0", "4"],
        ["decode", "FILE", "-", "--format", "gltf"],
        ["decode", "FILE", "out.glb", "--attributes", "positions"],
        ["convert", "FILE", "out.npz"],
        ["convert", "FILE", "out.ply", "--from", "scar"],
        ["completion", "tcsh"],
    ],
)
def test_wrong_arguments_are_exit_code_2(
    run: Run, explicit_scar: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names = {"FILE": str(explicit_scar), "OUT": "out.scar"}
    result = run(*(names.get(argument, argument) for argument in arguments))
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert list(tmp_path.iterdir()) == []


def test_an_existing_output_is_kept_unless_forced(run: Run, explicit_scar: Path, tmp_path: Path) -> None:
    target = tmp_path / "out.scar"
    target.write_bytes(b"precious")
    result = run("truncate", explicit_scar, target, "--layers", 1)
    assert result.exit_code == 2
    assert "output-exists" in result.stderr
    assert target.read_bytes() == b"precious"
    assert run("truncate", explicit_scar, target, "--layers", 1, "--force").exit_code == 0
    assert target.stat().st_size > 100


def test_a_failure_on_the_way_leaves_nothing_behind(run: Run, explicit_scar: Path, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    damaged = tmp_path / "in" / "damaged.scar"
    data = bytearray(explicit_scar.read_bytes())
    data[-1] ^= 1
    damaged.write_bytes(bytes(data))
    assert run("truncate", damaged, tmp_path / "out.scar", "--layers", 3).exit_code == 1
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


_INTERRUPTED = """
import os, signal, sys
from pathlib import Path
from scarfmt import cli as command
import scarfmt.tools.truncate
# A test run in the background of a shell hands down that SIGINT is ignored, nohup that SIGHUP is.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
def interrupted(source, layers, target):
    target.write(b"half")
    os.kill(os.getpid(), signal.{signal})
    import time; time.sleep(60)
scarfmt.tools.truncate.truncate_to = interrupted
sys.argv[1:] = ["truncate", {name!r}, "out.scar", "--layers", "1"]
command.main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.parametrize(("sent", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_an_interrupt_leaves_nothing_behind(explicit_scar: Path, tmp_path: Path, sent: str, code: int) -> None:
    script = _INTERRUPTED.format(signal=sent, name=str(explicit_scar))
    env = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, env=env, capture_output=True, check=False, timeout=50
    )
    assert done.returncode == code, done.stderr
    assert b"Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def failing(error: BaseException) -> click.Group:
    """A command that raises `error`."""

    @click.group(cls=FailureGroup)
    def group() -> None: ...

    @group.command()
    @requires_extra("encode")
    def work() -> None:
        raise error

    return group


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (MemoryError(), 1, "out-of-memory"),
        (PermissionError(13, "Permission denied", "x.ply"), 1, "os-error: [Errno 13] Permission denied: 'x.ply'"),
        (ModuleNotFoundError("No module", name="torch.nn"), 1, "pip install 'scarfmt[neural]'"),
        (ModuleNotFoundError("No module", name="numba"), 1, "pip install 'scarfmt[encode]'"),
        (InvalidInput("input-frame", "which way is up?"), 2, "input-frame: which way is up?"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_failures_by_exit_code(error: BaseException, code: int, text: str) -> None:
    from click.testing import CliRunner

    result = CliRunner().invoke(failing(error), ["work"])
    assert result.exit_code == code
    assert text in result.stderr


def test_a_bug_is_not_disguised_as_a_missing_package() -> None:
    from click.testing import CliRunner

    error = ModuleNotFoundError("No module named 'scarfmt.gone'", name="scarfmt.gone")
    assert CliRunner().invoke(failing(error), ["work"]).exception is error


def test_binary_data_is_not_written_to_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal:
        @property
        def buffer(self) -> Terminal:
            return self

        def isatty(self) -> bool:
            return True

    monkeypatch.setattr(sys, "stdout", Terminal())
    with pytest.raises(click.UsageError, match="terminal"), open_output("-", force=False):
        pass


def test_pipes_carry_whole_files(shell: Shell, explicit_scar: Path, run: Run, tmp_path: Path) -> None:
    done = shell("truncate", "-", "-", "--layers", 2, cwd=tmp_path, input=explicit_scar.read_bytes())
    assert done.returncode == 0
    run("truncate", explicit_scar, tmp_path / "file.scar", "--layers", 2)
    assert done.stdout == (tmp_path / "file.scar").read_bytes()
    assert b"2 layers" in done.stderr


@pytest.mark.parametrize("name", ["bash", "zsh", "fish"])
def test_completion_scripts_name_the_command(run: Run, name: str) -> None:
    assert "_SCARFMT_COMPLETE" in run("completion", name).stdout
    assert completion.name == "completion"

"""Shared properties of all subcommands: exit codes, where output goes, nothing half-written, a quick start."""

from __future__ import annotations

import errno
import json
import re
import sys
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import click
import pytest
from click.testing import CliRunner

import scarfmt.cli
from scarfmt import __version__
from scarfmt.cli import COMMANDS, load
from scarfmt.cli.failures import FailureGroup, requires_extra
from scarfmt.cli.files import open_output
from scarfmt.errors import InvalidInput
from scarfmt.native.binding import describe
from tests.cli.conftest import python, run, shell

HEAVY = ["torch", "numba", "scipy", "plyfile", "fsspec", "aiohttp", "rich", "PIL"]


def test_version() -> None:
    first, second = run("-V").stdout.splitlines()
    assert __version__ in first
    assert second == f"engine: {describe()}"


def test_help_of_a_command_by_either_name() -> None:
    assert run("help", "split").stdout == run("split", "-h").stdout != run("help").stdout == run("-h").stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_is_explained(name: str) -> None:
    for parameter in load(name).params:
        if isinstance(parameter, click.Option):
            assert parameter.help


def test_every_command_is_listed() -> None:
    modules = [import_module(f"scarfmt.cli.{module.name}") for module in iter_modules(scarfmt.cli.__path__)]
    found = {
        name for module in modules if isinstance(getattr(module, name := module.__name__[12:], None), click.Command)
    }
    assert found == set(COMMANDS)
    assert list(COMMANDS) == sorted(COMMANDS)


def test_a_command_loads_no_other() -> None:
    done = python("-c", "import sys; from scarfmt.cli import load; load('truncate'); print(list(sys.modules))")
    assert not [name for name in COMMANDS if name != "truncate" and f"'scarfmt.cli.{name}'".encode() in done.stdout]


@pytest.mark.parametrize(
    ("arguments", "heavy"),
    [(["-h"], ["numpy"]), *((said.split(), HEAVY) for said in ("-h", "inspect FILE", "encode -h", "train -h"))],
)
def test_heavy_packages_are_not_imported_by_light_commands(
    explicit_scar: Path, arguments: list[str], heavy: list[str]
) -> None:
    """Help does not even import numpy."""
    arguments = [str(explicit_scar) if argument == "FILE" else argument for argument in arguments]
    script = (
        f"import sys; from scarfmt.cli import cli; cli({arguments!r}, standalone_mode=False);"
        f"print('LOADED', [name for name in {heavy!r} if name in sys.modules])"
    )
    assert b"LOADED []" in python("-c", script).stdout


def test_an_invalid_file_is_one_line_on_stderr_and_exit_code_1(tmp_path: Path) -> None:
    (tmp_path / "bad.scar").write_bytes(b"no scene at all")
    done = shell("inspect", "bad.scar", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout == b""
    assert re.fullmatch(rb"scarfmt: error: bad-signature: .*\(signature, byte 0\)\r?\n", done.stderr)


WRONG = {
    "": ["enkode", "--nonsense", "inspect", "merge -o OUT", "merge FILE", "completion tcsh", "view FILE FILE FILE"],
    "inspect FILE": ["--nonsense"],
    "dump FILE": ["--block header"],
    "truncate FILE": ["OUT --layers 0", "OUT --layers 9", "FILE --layers 1", "no/such/folder/out.scar --layers 1"],
    "split FILE": ["OUT", "OUT --files 1", "OUT --files 999", "OUT --files 2 --rest FILE", "- --files 2"],
    "validate FILE": ["--layers 9"],
    "encode": ["FILE a.txt", "FILE a", "- OUT --work w"],
    "encode FILE OUT": [
        *("--metadata text", "--quality 500", "--quality 30 --worst 25", "--tile-size 1000", "--only-cameras"),
        *("--resume", "--workers 2", "--cluster tcp://localhost:8786", "--range-size 5000"),
    ],
    "encode FILE OUT --work w": ["--workers 2 --cluster tcp://localhost:8786", "--range-size 5"],
    "train FILE": ["FILE", "- --json", "- --slice-minutes 1"],
    "train FILE OUT": ["--minutes 1 --iterations 5", "--minutes 0", "--hold-out 1", "--lambda 1e9", "--run FILE"],
    "compare FILE FILE": ["--cameras FILE --from near", "--size 640", "--size 0x480", "--photos / --views 3"],
    "compare": ["FILE FILE --all-layers --layers-b 1", "PLY PLY --layers-a 1", "PLY PLY --all-layers"],
    "render FILE OUT": ["--layers some", "--layers 0"],
    "decode FILE": ["out.obj", "- --json", "- --format gltf", "out.spz --spz-sh-bits 0 4"],
    "decode FILE out.ply": ["--box 1,2,3", "--box 0,0,0,1,1,nan", "--tiles one", "--layers 9", "--bake-steps 3",
                            "--cameras FILE", "--camera 1,2,3 --target 1,2,3",
                            "--target 1,2,9 --camera 1,2,3 --up 0,0,1"],
    "decode": ["FILE out.ply --tiles 0,0", "FILE out.ply --spz-version 3", "FILE out.glb --attributes positions",
               "FILE a.npz --attributes positions --budget 9"],
    "convert FILE": ["out.npz", "out.ply --from scar"],
}


@pytest.mark.parametrize("said", [f"{start} {rest}" for start, rests in WRONG.items() for rest in rests])
def test_wrong_arguments_are_one_line_and_exit_code_2(
    explicit_scar: Path, ply: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    names = {"FILE": explicit_scar, "PLY": ply, "OUT": "out.scar"}
    result = run(*(names.get(argument, argument) for argument in said.split()))
    assert (result.exit_code, result.stdout) == (2, "")
    line = r"scarfmt: error: (input-usage: .*; see scarfmt.* --help|(input|output)-(?!usage)[a-z]+: .*)\n"
    assert re.fullmatch(line, result.stderr)
    assert list(tmp_path.iterdir()) == []


def test_errors_name_options_not_parameters(explicit_scar: Path, tmp_path: Path) -> None:
    result = run("truncate", explicit_scar, tmp_path / "a.scar", "--layers", 9)
    assert result.stderr.endswith("(--layers)\n")


def test_reports_are_lines_or_a_document(explicit_scar: Path, ply: Path, tmp_path: Path) -> None:
    """--json: one object on stdout, and no line for people. --quiet prints it all the same."""
    commands = {
        "inspect": (explicit_scar,),
        "validate": (explicit_scar,),
        "truncate": (explicit_scar, tmp_path / "a.scar", "--layers", 1),
        "decode": (explicit_scar, tmp_path / "a.npz", "-q"),
        "convert": (ply, tmp_path / "a.spz"),
        "encode": (ply, tmp_path / "b.scar", "--effort", 1, "--layers", 1, "--corrections", 0),
        "merge": (explicit_scar, "-o", tmp_path / "c.scar"),
        "split": (explicit_scar, tmp_path / "d.scar", "--files", 2),
        "render": (ply, tmp_path / "e", "--views", 1, "--size", "32x24"),
        "compare": (ply, ply, "--views", 1, "--size", "32x24"),
    }
    for name, arguments in commands.items():
        result = run(name, *arguments, "--json")
        assert result.exit_code == 0, result.output
        assert isinstance(json.loads(result.stdout), dict)
        assert [line for line in result.stderr.splitlines() if "warning" not in line] == []
    piped = run("truncate", explicit_scar, "-", "--layers", 1, "--json")
    assert (piped.exit_code, piped.stdout) == (2, "")


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
    done = python("-c", _INTERRUPTED.format(signal=sent, name=str(explicit_scar)), cwd=tmp_path)
    assert done.returncode == code, done.stderr
    assert b"Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def failing(error: BaseException) -> click.Group:
    """A command that raises `error`."""

    @click.group(cls=FailureGroup)
    def group() -> None: ...

    @group.command()
    @requires_extra("render")
    def work() -> None:
        raise error

    return group


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (MemoryError(), 1, "out-of-memory"),
        (PermissionError(13, "Permission denied", "x.ply"), 1, "os-error: [Errno 13] Permission denied: 'x.ply'"),
        (OSError(errno.ENOSPC, "No space left"), 1, "os-full: [Errno"),
        (ModuleNotFoundError("No module", name="torch.nn"), 1, "pip install 'scarfmt[train]'"),
        (ModuleNotFoundError("No module", name="PIL"), 1, "pip install 'scarfmt[render]'"),
        (InvalidInput("input-frame", "which way is up?"), 2, "input-frame: which way is up?"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_failures_by_exit_code(error: BaseException, code: int, text: str) -> None:
    result = CliRunner().invoke(failing(error), ["work"])
    assert result.exit_code == code
    assert text in result.stderr


def test_a_bug_is_not_disguised_as_a_missing_package() -> None:
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


@pytest.mark.parametrize("name", ["bash", "zsh", "fish"])
def test_completion_scripts_name_the_command(name: str) -> None:
    assert "_SCARFMT_COMPLETE" in run("completion", name).stdout


@pytest.mark.parametrize(
    ("command", "name"),
    [
        *(("truncate", name) for name in ("same", "./same", "link", "hard.scar")),
        *((command, "hard.scar") for command in ("split", "merge", "convert", "encode", "decode")),
    ],
)
def test_no_input_is_overwritten_even_if_forced(
    explicit_scar: Path, ply: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, name: str
) -> None:
    """By whatever name the output is the same file."""
    monkeypatch.chdir(tmp_path)
    source = ply if command in ("convert", "encode") else explicit_scar
    Path("same").write_bytes(source.read_bytes())
    Path("link").symlink_to("same")
    Path("hard.scar").hardlink_to("same")
    more = {
        "truncate": ("same", name, "--layers", 1),
        "split": ("same", "new", "--box", "0,0,0,9,9,9", "--rest", name),
        "merge": ("same", "-o", name),
        "convert": ("same", name, "--format", "ply"),
        "encode": ("same", name, "--effort", 1),
        "decode": ("same", name, "--format", "ply"),
    }[command]
    result = run(command, *more, "--force")
    assert (result.exit_code, "output-path" in result.stderr) == (2, True), result.output
    assert Path("same").read_bytes() == source.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["hard.scar", "link", "same"]


def test_no_two_outputs_are_one_file(explicit_scar: Path, tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"old")
    (tmp_path / "b").hardlink_to(tmp_path / "a")
    for rest in ("a", "b", "../" + tmp_path.name + "/a"):
        box = "-1,-1,-1,1,1,1"
        result = run("split", explicit_scar, tmp_path / "a", "--box", box, "--rest", tmp_path / rest, "--force")
        assert (result.exit_code, result.stderr.count("is another output")) == (2, 1)
    assert (tmp_path / "a").read_bytes() == b"old"


def test_a_buffer_that_a_scene_names_is_not_overwritten(ply: Path, tmp_path: Path) -> None:
    assert run("convert", ply, tmp_path / "a.gltf").exit_code == 0
    before = (tmp_path / "a.bin").read_bytes()
    result = run("convert", tmp_path / "a.gltf", tmp_path / "a.bin", "--format", "ply", "--force")
    assert (result.exit_code, "a.bin is an input" in result.stderr) == (2, True)
    assert (tmp_path / "a.bin").read_bytes() == before


def test_nothing_lies_in_the_work_directory(ply: Path, tmp_path: Path) -> None:
    (tmp_path / "scene").write_bytes(ply.read_bytes())
    for names in ((tmp_path / "scene", tmp_path.parent / "a.scar"), (ply, tmp_path / "models.scar")):
        result = run("encode", *names, "--work", tmp_path)
        assert (result.exit_code, "output-path" in result.stderr) == (2, True)
    assert [path.name for path in tmp_path.iterdir()] == ["scene"]

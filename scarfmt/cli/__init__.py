"""The `scarfmt` command. Each subcommand is one module, loaded when it is asked for.

Conventions: results that programs read (JSON, files written to `-`) on stdout, everything for people on stderr;
exit codes in :mod:`scarfmt.cli.failures`.
"""

from __future__ import annotations

import contextlib
import ctypes
import io
import os
import signal
import sys
from importlib import import_module
from types import FrameType

import click

from scarfmt import __version__
from scarfmt.cli.failures import FailureGroup

__all__ = ["COMMANDS", "cli", "load", "main"]

COMMANDS = {
    "compare": "Report PSNR and SSIM between two scenes.",
    "completion": "Print a shell completion script.",
    "conformance": "Score any decoder against the test vectors.",
    "convert": "Convert a scene between PLY, SPZ, glTF and others.",
    "decode": "Decode a file into a PLY, SPZ or glTF that viewers open.",
    "dump": "Annotate every byte of a file.",
    "encode": "Compress a scene into a .scar file.",
    "export": "Write a web page that shows a file by itself.",
    "inspect": "Report what a file holds.",
    "merge": "Join files of parts of one scene.",
    "render": "Draw a scene into PNG pictures.",
    "split": "Cut a file into files of parts of the scene.",
    "train": "Train a .scar file from photos.",
    "truncate": "Keep only the first layers of a file.",
    "validate": "List every rule a file breaks.",
    "view": "Show scenes in the browser.",
}
"""What each command does. Its module here has its name, and so has the command in it."""


def load(name: str) -> click.Command:
    """The command of that name of `COMMANDS`."""
    command = getattr(import_module(f"scarfmt.cli.{name}"), name)
    assert isinstance(command, click.Command)
    command.short_help = COMMANDS[name]
    return command


class _Commands(FailureGroup):
    """The commands of `COMMANDS`. Help lists them without loading any."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        return load(cmd_name) if cmd_name in COMMANDS else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


def _version(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    if not wanted or context.resilient_parsing:
        return
    from scarfmt.native.binding import describe

    click.echo(f"scarfmt, version {__version__}\nengine: {describe()}")
    context.exit()


@click.group(
    "scarfmt",
    cls=_Commands,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.option(
    "--version", "-V", is_flag=True, expose_value=False, is_eager=True, callback=_version,
    help="Show the version, and which engine computes, and exit.",
)  # fmt: skip
def cli() -> None:
    """Compress, view and measure 3D Gaussian splats (.scar files).

    \b
    A first round:
      scarfmt encode scene.ply scene.scar       compress a trained scene
      scarfmt train photos/ scene.scar          or train one from photos
      scarfmt inspect scene.scar                what is in it, layer by layer
      scarfmt truncate scene.scar small.scar --layers 2
      scarfmt view scene.scar                   look at it in the browser
      scarfmt decode small.scar small.ply       back to what viewers open
      scarfmt compare scene.ply small.scar      how much it differs, in dB

    A file name of - is standard input or output. Exit codes: 0 done; 1 the input is invalid or the work failed;
    2 wrong arguments; 130 interrupted.
    """


def _terminate(received: int, _frame: FrameType | None) -> None:
    # As an exception, so that half-written files are removed.
    raise SystemExit(128 + received)


def _end_cleanly_on_signals() -> None:
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:  # nohup ignores it: so it stays
            signal.signal(number, _terminate)


_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8


def _reuse_memory() -> None:
    """Keep what arrays leave for the next ones, of any thread: the system fills pages with zeros before it gives them
    (glibc only)."""
    with contextlib.suppress(AttributeError, OSError, TypeError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_M_MMAP_THRESHOLD, 1 << 25)
        mallopt(_M_TRIM_THRESHOLD, 1 << 29)
        mallopt(_M_ARENA_MAX, 1)


def main() -> None:
    """Entry point of the `scarfmt` command."""
    _end_cleanly_on_signals()
    _reuse_memory()
    # Names of files may hold bytes, and messages characters, that the terminal's encoding lacks.
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    # Tiles are what is worth working on side by side: threads inside products this small only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    cli(prog_name="scarfmt")

"""The `scarfmt` command. Each subcommand is one module; none imports more than click before it runs.

Conventions: results that programs read (JSON, files written to `-`) on stdout, everything for people on stderr;
exit codes in :mod:`scarfmt.cli.failures`.
"""

from __future__ import annotations

import io
import os
import signal
import sys
from types import FrameType

import click

from scarfmt import __version__
from scarfmt.cli.compare import compare
from scarfmt.cli.completion import completion
from scarfmt.cli.conformance import conformance
from scarfmt.cli.convert import convert
from scarfmt.cli.decode import decode
from scarfmt.cli.dump import dump
from scarfmt.cli.encode import encode
from scarfmt.cli.failures import FailureGroup
from scarfmt.cli.inspect import inspect
from scarfmt.cli.merge import merge
from scarfmt.cli.render import render
from scarfmt.cli.split import split
from scarfmt.cli.train import train
from scarfmt.cli.truncate import truncate
from scarfmt.cli.validate import validate
from scarfmt.cli.view import view

__all__ = ["cli", "main"]


def _version(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    if not wanted or context.resilient_parsing:
        return
    from scarfmt.native.binding import described

    click.echo(f"scarfmt, version {__version__}\nengine: {described()}")
    context.exit()


@click.group(
    "scarfmt",
    cls=FailureGroup,
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


for _command in (
    *(encode, train, view, decode, convert, inspect, truncate, split, merge),
    *(validate, dump, compare, render, conformance, completion),
):
    cli.add_command(_command)


def _terminate(received: int, _frame: FrameType | None) -> None:
    # As an exception, so that half-written files are removed.
    raise SystemExit(128 + received)


def _end_cleanly_on_signals() -> None:
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:  # nohup ignores it: so it stays
            signal.signal(number, _terminate)


def main() -> None:
    """Entry point of the `scarfmt` command."""
    _end_cleanly_on_signals()
    # Names of files may hold bytes, and messages characters, that the terminal's encoding lacks.
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    # Tiles are what is worth working on side by side: threads inside products this small only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    cli(prog_name="scarfmt")

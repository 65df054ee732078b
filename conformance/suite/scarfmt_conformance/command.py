"""`scarfmt conformance`: score any decoder against the conformance vectors."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from scarfmt.cli.failures import FAILED
from scarfmt.cli.files import open_output, print_json
from scarfmt.cli.options import with_options
from scarfmt.cli.progress import progress
from scarfmt.errors import InvalidInput

if TYPE_CHECKING:
    from scarfmt_conformance.runner import Result

_REFERENCE = "-"
_SHOWN_FAILURES = 20
_SUITE_HELP = "Folder with manifest.json, or a zip of it [default: ./conformance, else those installed]."

_selection_options = with_options(
    click.option("--suite", metavar="PLACE", help=_SUITE_HELP),
    click.option("--only", metavar="GLOB", multiple=True, help="Select ids that match, e.g. 'valid/index-*'."),
    click.option("--class", "classes", metavar="NAME", multiple=True, help="Select a class: valid, edge, ..."),
    click.option("--feature", "features", metavar="WORD", multiple=True, help="Select vectors with this feature."),
)
"""The options that select vectors."""


@click.group(short_help="Score any decoder against the test vectors.")
def conformance() -> None:
    """Score any decoder, in any language, against the conformance vectors.

    The decoder is a command that answers questions about files in JSON. conformance/PROTOCOL.md defines questions and
    answers.

    \b
    Examples:
      scarfmt conformance run --decoder './mine {file} --layers {layers} --stage {stage}'
      scarfmt conformance list --class invalid
    """


@conformance.command("list", short_help="List the vectors.")
@_selection_options
def list_(suite: str | None, **selection: tuple[str, ...]) -> None:
    """List the vectors, and the features to select them by.

    \b
    Examples:
      scarfmt conformance list --feature hash-grid
    """
    from scarfmt_conformance import report
    from scarfmt_conformance.manifest import Selection, find_suite, open_suite

    with open_suite(find_suite(suite)) as found:
        click.echo(report.list_text(Selection(**selection).of(found.vectors)), nl=False)


@conformance.command(short_help="Write the vectors to a folder.")
@click.option("--suite", metavar="PLACE", help=_SUITE_HELP)
@click.argument("folder", metavar="FOLDER")
def unpack(suite: str | None, folder: str) -> None:
    """Write the vectors, their manifest and the protocol into a new folder.

    \b
    Examples:
      scarfmt conformance unpack vectors
    """
    import shutil
    from pathlib import Path

    from scarfmt_conformance.manifest import find_suite, open_suite

    if Path(folder).exists():
        raise InvalidInput("output-exists", f"{folder} exists already: give the name of a new folder")
    with open_suite(find_suite(suite)) as found:
        shutil.copytree(found.folder, folder)
    click.echo(f"{len(found.vectors)} vectors in {folder}", err=True)


def parse_stages(_ctx: click.Context, _parameter: click.Parameter, value: str | None) -> tuple[str, ...] | None:
    """Stages of `NAME,...`.

    Raises:
        click.BadParameter: a name that no stage has.
    """
    if value is None:
        return None
    from scarfmt_conformance.protocol import STAGES

    names = tuple(value.split(","))
    if not set(names) <= set(STAGES):
        raise click.BadParameter(f"{value!r}: choose from {', '.join(STAGES)}")
    return names


@conformance.command("run", short_help="Ask a decoder about every vector.")
@click.option(
    "--decoder",
    metavar="CMD",
    help="Command to run for each question, with {file} {layers} {stage} in it, and {camera} for anchor models.",
)
@click.option(
    "--session",
    metavar="CMD",
    is_flag=False,
    flag_value=_REFERENCE,
    help="Command to start once and ask line by line. Without CMD, the reference decoder is started.",
)
@_selection_options
@click.option("--stages", metavar="NAME,...", callback=parse_stages, help="Compare only these stages.")
@click.option("--all-layers/--last-layer", default=True, help="Ask for every pinned layer, or the last [default: all].")
@click.option("--timeout", type=click.FloatRange(0.01), default=60.0, show_default=True, help="Maximum seconds each.")
@click.option("--memory", type=click.IntRange(16, 1 << 20), default=2048, show_default=True, help="MiB of a process.")
@click.option("--jobs", type=click.IntRange(1, 64), default=1, show_default=True, help="Decoders that run at once.")
@click.option("--format", "format_", type=click.Choice(["table", "json"]), default="table", help="Format on stdout.")
@click.option("--junit", metavar="FILE.xml", help="Write the report as JUnit XML too, for CI servers.")
@click.option("--force", is_flag=True, help="Overwrite the file of --junit.")
@click.option("--verbose", "-v", is_flag=True, help="Report every vector, and show every failure.")
@click.pass_context
def run_(ctx: click.Context, /, decoder: str | None, session: str | None, **wanted: Any) -> None:
    """Ask a decoder about every vector and report where it differs from the specification.

    The command of a decoder may hang, crash or print anything. Each of these counts as a failure of the vector it was
    asked about. Without --decoder or --session the reference decoder is scored. The exit code is 0 if nothing failed,
    else 1.

    \b
    Examples:
      scarfmt conformance run --decoder './mine {file} --layers {layers} --stage {stage}'
      scarfmt conformance run --session 'node mine.mjs --session' --jobs 4 --junit report.xml
      scarfmt conformance run --session './mine -s' --only 'valid/index-*' --stages models,indices -v
    """
    from scarfmt_conformance import report
    from scarfmt_conformance.manifest import Selection, find_suite, open_suite
    from scarfmt_conformance.process import Limits, Program
    from scarfmt_conformance.protocol import STAGES
    from scarfmt_conformance.runner import Options, run

    words = _command_words(decoder, session)
    limits = Limits(wanted["timeout"], wanted["memory"] << 20)
    selection = Selection(**{name: wanted[name] for name in ("only", "classes", "features")})
    options = Options(wanted["stages"] or STAGES, not wanted["all_layers"], wanted["jobs"])
    with ExitStack() as files, progress(wanted["format_"] == "json" or wanted["verbose"]) as bar:
        suite = files.enter_context(open_suite(find_suite(wanted["suite"])))
        vectors = selection.of(suite.vectors)
        junit = files.enter_context(open_output(wanted["junit"], wanted["force"])) if wanted["junit"] else None
        tell = partial(_report, itertools.count(1), len(vectors), wanted["verbose"], bar)
        score = run(suite, vectors, partial(Program, words, limits, session is not None), options, tell)
        if junit is not None:
            junit.write(report.junit(score))
    if wanted["format_"] == "json":
        print_json(report.as_json(score, words))
    else:
        click.echo(report.score_text(score), nl=False)
    click.echo(report.failures_text(score, len(score.results) if wanted["verbose"] else _SHOWN_FAILURES), err=True)
    if not score.passed:
        ctx.exit(FAILED)


def _command_words(decoder: str | None, session: str | None) -> list[str]:
    """The command of the decoder, or of the session if there is one.

    Raises:
        click.UsageError: both ways at once, a program that does not exist, or no POSIX system.
        InvalidInput: ``input-options``: the command is not one.
    """
    import os
    import shutil

    from scarfmt_conformance.protocol import command, template

    if os.name != "posix":
        raise click.UsageError("decoders can be run safely on POSIX systems only")
    if decoder is not None and session is not None:
        raise click.UsageError("--decoder and --session exclude each other")
    reference = [sys.executable, "-m", "scarfmt_conformance.reference.answers"]
    if decoder is not None:
        words = template(decoder)
    elif session is None:
        words = [*reference, "{file}", "--layers", "{layers}", "--stage", "{stage}", "--camera={camera}"]
    else:
        words = [*reference, "--session"] if session == _REFERENCE else command(session)
    if shutil.which(words[0]) is None:
        raise click.UsageError(f"there is no program {words[0]!r}")
    return words


def _report(done: Iterator[int], total: int, verbose: bool, bar: Callable[[str, float], None], result: Result) -> None:
    """The progress of a run: a bar, or with -v a line per vector."""
    number = next(done)
    if verbose:
        reason = f"  {result.reason}" if result.reason else ""
        click.echo(f"{result.outcome:<7}  {result.seconds:7.2f} s  {result.vector.id}{reason}", err=True)
    else:
        bar(result.vector.id, number / total)

"""`scarfmt train`: from photos to a .scar file."""

from __future__ import annotations

import math
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, NoReturn

import click

from reference_encoder.training.options import (
    DEFAULT_MINUTES,
    DEVICES,
    FINISHING,
    HOLD_OUT,
    LEAST_RESOLUTION,
    MAX_ITERATIONS,
    MAX_LAMBDA,
    MAX_LAST_LAYER,
    MAX_MINUTES,
    MIN_LAMBDA,
    MIN_LAST_LAYER,
    MIN_SIZE,
    PAPER_ITERATIONS,
    Progress,
    Stop,
    Suspended,
    Trained,
    TrainOptions,
    never,
)
from reference_encoder.training.presets import PRESETS
from scarfmt.cli.failures import INTERRUPTED, UNFINISHED, requires_extra, warnings_on_stderr
from scarfmt.cli.files import STANDARD, check_output, open_output
from scarfmt.cli.progress import Tell, duration, progress
from scarfmt.cli.report import Report, reports
from scarfmt.errors import plural
from scarfmt.limits import MAX_LAYERS

if TYPE_CHECKING:
    from reference_encoder.training.capture import Capture

DEFAULTS = TrainOptions()
RUN_ENDING = ".run"


@click.command()
@click.argument("capture", type=click.Path())
@click.argument("output")
@click.option(
    "--minutes",
    type=click.FloatRange(0, MAX_MINUTES, min_open=True),
    metavar="M",
    help=f"Minutes from the start to the file, with reading and poses [default: {DEFAULT_MINUTES:g}].",
)
@click.option(
    "--iterations",
    type=click.IntRange(1, MAX_ITERATIONS),
    metavar="N",
    help=f"Number of iterations to train, in place of --minutes [default with --preset paper: {PAPER_ITERATIONS:,}].",
)
@click.option(
    "--resolution",
    type=click.IntRange(min=LEAST_RESOLUTION),
    metavar="PIXELS",
    help="Maximum pixels of the longest side of a photo; larger photos are scaled down [default: no limit].",
)
@click.option(
    "--layers", type=click.IntRange(1, MAX_LAYERS), help=f"Number of layers of the file [default: {DEFAULTS.layers}]."
)
@click.option(
    "--last-layer",
    type=click.FloatRange(MIN_LAST_LAYER, MAX_LAST_LAYER),
    metavar="TIMES",
    help="How much more often the last layer is trained than each other layer. 16 makes the whole file better and"
    f" its first layers worse [default: {DEFAULTS.last_layer:g}].",
)
@click.option(
    "--lambda",
    "lambda_",
    type=click.FloatRange(MIN_LAMBDA, MAX_LAMBDA),
    metavar="FACTOR",
    help="Trade-off of size against quality: 2 is smaller and worse, 0.5 larger and better"
    f" [default: {DEFAULTS.lambda_:g}].",
)
@click.option(
    "--size",
    type=click.IntRange(min=MIN_SIZE),
    metavar="BYTES",
    help="Target size of the file in bytes. The file stays below it where more bytes improve pictures too little"
    " [default: none; --lambda decides].",
)
@click.option(
    "--preset",
    type=click.Choice(list(PRESETS)),
    help="Parts of the method to use. default: those that save bytes. rvq: these, with codewords for features. paper:"
    f" the configuration of the SCAR-GS paper [default: {DEFAULTS.preset}].",
)
@click.option(
    "--device", type=click.Choice(DEVICES), help=f"Device; cuda is an NVIDIA GPU [default: {DEFAULTS.device}]."
)
@click.option(
    "--hold-out",
    type=click.IntRange(min=0),
    metavar="N",
    help="Hold out every Nth photo by name, to measure quality. 0: train on all photos. If the capture marks test"
    f" cameras, those are held out instead [default: {HOLD_OUT}].",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    help="Seed for all random choices. With --iterations, the same seed gives the same file on the same machine"
    f" [default: {DEFAULTS.seed}].",
)
@click.option(
    "--run",
    "--resume",
    "folder",
    metavar="DIR",
    type=click.Path(file_okay=False),
    help="Folder for checkpoints, log and plot. If it holds an interrupted run of the same capture and options, that"
    f" run continues [default: OUTPUT{RUN_ENDING}].",
)
@click.option(
    "--slice-minutes",
    type=click.FloatRange(0, MAX_MINUTES, min_open=True),
    metavar="M",
    help="Maximum minutes of this call, which then stops with exit code 75; the same command continues"
    " [default: train to the end].",
)
@click.option("--force", is_flag=True, help="Overwrite OUTPUT if it exists.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
@reports
@requires_extra("train", torch="train")
def train(capture: str, output: str, folder: str | None, force: bool, quiet: bool, **given: Any) -> Report:
    """Train the .scar file OUTPUT from the photos CAPTURE.

    CAPTURE is a folder: of COLMAP, with a transforms.json (Nerfstudio, Blender), with a cameras.json of this project,
    or of photos alone; or a video. Without poses, the command finds them first. After an interruption the same command
    continues. Ctrl-C ends training early and writes the best file so far. A second Ctrl-C aborts.

    \b
    Examples:
      scarfmt train capture/ scene.scar
      scarfmt train capture/ scene.scar --minutes 10 --resolution 640
      scarfmt train clip.mp4 small.scar --lambda 4 --layers 3
      scarfmt train capture/ scene.scar --preset paper --run runs/paper
    """
    started = time.monotonic()
    hold_out, resolution, slice_minutes = given.pop("hold_out"), given.pop("resolution"), given.pop("slice_minutes")
    leave = never if slice_minutes is None else _after(slice_minutes)
    options = TrainOptions(**{name: value for name, value in given.items() if value is not None}).resolve()
    check_output(output, force)
    run = _run_folder(output) if folder is None else Path(folder)
    if slice_minutes is not None and run is None:
        raise click.UsageError("--slice-minutes needs a folder for checkpoints: give --run")
    with warnings_on_stderr(quiet), _workspace(run) as workspace:
        with progress(quiet) as report:
            photos = _read(capture, resolution, HOLD_OUT if hold_out is None else hold_out, workspace, report)
        photos = replace(photos, seconds=time.monotonic() - started)
        if not quiet:
            _print_capture(photos)
        with progress(quiet) as report, _stoppable(quiet) as stop:
            trained = _train(photos, options, run, quiet, report, stop, leave)
            with open_output(output, force) as target:
                target.write(trained.data)
        interrupted = stop()
    code = _end(run, interrupted, quiet)
    return Report(asdict(trained) | {"data": len(trained.data)}, _summary(trained), code=code)


def _run_folder(output: str) -> Path | None:
    """The default folder of a run, beside the output; None if the output is not a regular file."""
    if output == STANDARD or (Path(output).exists() and not Path(output).is_file()):
        return None
    return Path(output + RUN_ENDING)


@contextmanager
def _workspace(run: Path | None) -> Iterator[Path]:
    """A folder for scaled or undistorted photos. The folder of the run is used, so that they are made only once."""
    if run is not None:
        yield run
        return
    with tempfile.TemporaryDirectory(prefix="scarfmt-") as folder:
        yield Path(folder)


@contextmanager
def _stoppable(quiet: bool) -> Iterator[Stop]:
    """While active, the first Ctrl-C makes the function given return True; the second one interrupts."""
    asked: list[bool] = []

    def ask(_signal: int, _frame: FrameType | None) -> None:
        if asked:
            raise KeyboardInterrupt
        asked.append(True)
        if not quiet:
            click.echo("scarfmt: ending early; Ctrl-C again to abort", err=True)

    before = signal.getsignal(signal.SIGINT)
    if before != signal.SIG_IGN:
        signal.signal(signal.SIGINT, ask)
    try:
        yield lambda: bool(asked)
    finally:
        signal.signal(signal.SIGINT, before)


def _after(minutes: float) -> Stop:
    """A function that returns True from `minutes` after now."""
    end = time.monotonic() + 60 * minutes
    return lambda: time.monotonic() >= end


def _read(path: str, resolution: int | None, hold_out: int, workspace: Path, report: Tell) -> Capture:
    import reference_encoder.training.run  # noqa: F401 - what takes long is loaded while the time of reading counts
    from reference_encoder.training.capture import load_capture

    return load_capture(path, resolution, hold_out, workspace, report)


def _train(
    capture: Capture, options: TrainOptions, run: Path | None, quiet: bool, report: Tell, stop: Stop, leave: Stop
) -> Trained:
    from reference_encoder.training.run import train as train_capture
    from reference_encoder.training.run_folder import last_iteration

    before = None if run is None else last_iteration(run)
    if before is not None and not quiet:
        click.echo(f"continuing from iteration {before:,}", err=True)

    def tell(now: Progress) -> None:
        report(_describe(now), now.seconds / max(now.seconds + now.seconds_left, 1e-9))
        if now.phase == FINISHING and not quiet:
            click.echo(f"scarfmt: {FINISHING}; if cut off, the same command goes on, from {run}", err=True)

    try:
        trained: Trained = train_capture(capture, options, run, tell, stop, leave)
    except Suspended as left:
        _leave_off(left, run, quiet)
    except KeyboardInterrupt:
        _print_kept(run, quiet)
        raise
    return trained


def _print_kept(run: Path | None, quiet: bool) -> None:
    """Say what an aborted run leaves."""
    from reference_encoder.training.run_folder import DRAFT

    if run is None or quiet:
        return
    draft = f"; {run / DRAFT} is the file so far" if (run / DRAFT).is_file() else ""
    click.echo(f"scarfmt: aborted: the same command continues, from {run}{draft}", err=True)


def _leave_off(left: Suspended, run: Path | None, quiet: bool) -> NoReturn:
    """Report how to continue, and exit with code 75."""
    if not quiet:
        click.echo(f"scarfmt: {left}: the same command continues, from {run}", err=True)
    click.get_current_context().exit(UNFINISHED)


def _end(run: Path | None, interrupted: bool, quiet: bool) -> int:
    """Remove the checkpoints, unless training was interrupted; then keep them and report so. Returns the exit code."""
    from reference_encoder.training.run_folder import discard_checkpoints

    if not interrupted:
        if run is not None:
            discard_checkpoints(run)
        return 0
    if not quiet:
        more = f"; the same command with --force continues, from {run}" if run is not None else ""
        click.echo(f"scarfmt: interrupted: the best file so far is written{more}", err=True)
    return INTERRUPTED


def _describe(now: Progress) -> str:
    """The progress of training in one line."""
    words = [now.phase, f"{now.iteration:,}/{now.iterations:,}"]
    if now.psnr is not None:
        words.append(f"{now.psnr:.2f} dB")
    if now.bytes is not None:
        words.append(f"{now.bytes / 1000:,.0f} kB")
    words.append(f"{now.anchors:,} anchors")
    return " · ".join(words)


def _print_capture(capture: Capture) -> None:
    from reference_encoder.training.room import describe_room

    sizes = sorted({f"{photo.camera.width}x{photo.camera.height}" for photo in capture.photos})
    size = sizes[0] if len(sizes) == 1 else f"{len(sizes)} sizes"
    line = f"{len(capture.photos)} photos of {size}, {len(capture.test)} held out; {len(capture.points):,} points"
    click.echo(f"{line}; about {describe_room(capture)}", err=True)


def _summary(trained: Trained) -> str:
    lines = [f"{plural(trained.iterations, 'iteration')} in {duration(trained.seconds)}"]
    for number, layer in enumerate(trained.layers, 1):
        quality = "" if math.isnan(layer.psnr) else f"  {layer.psnr:6.2f} dB  SSIM {layer.ssim:.4f}"
        lines.append(f"layer {number}: {layer.bytes:>12,} bytes{quality}")
    return "\n".join(lines)

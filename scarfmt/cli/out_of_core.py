"""`scarfmt encode --work`: encodes scenes larger than memory, in ranges, with several workers."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO, TypeVar

import click

from reference_encoder.options import DEFAULT_RANGE, MIN_RANGE
from scarfmt import __version__
from scarfmt.cli.failures import warnings_on_stderr
from scarfmt.cli.files import STANDARD, open_output
from scarfmt.cli.progress import progress
from scarfmt.errors import InputWarning, InvalidInput

if TYPE_CHECKING:
    from reference_encoder.judge.quality import Quality
    from reference_encoder.options import EncodeOptions

LARGE_SCENE = 4_000_000
"""Gaussians of which encoding in memory takes about 5 GB at effort 1 and 20 GB at effort 2."""

_NAMES = ("work", "workers", "cluster", "resume", "range_size")

Command = TypeVar("Command", bound=Callable[..., Any])


def out_of_core_options(command: Command) -> Command:
    """Add the options of which :class:`OutOfCore` is made."""
    for option in (
        click.option("--range-size", type=click.IntRange(MIN_RANGE), metavar="N",
            help="With --work: number of Gaussians in a range. A worker needs memory for one range"
            f" [default: {DEFAULT_RANGE}]."),
        click.option("--resume", is_flag=True,
            help="With --work: continue an interrupted encode from DIR. The result is the same."),
        click.option("--cluster", metavar="ADDRESS",
            help="With --work: address of a Dask scheduler whose workers encode. All must reach INPUT and DIR."),
        click.option("--workers", type=click.IntRange(1), metavar="N",
            help="With --work: number of processes [default: 1]."),
        click.option("--work", metavar="DIR",
            help="Encode in ranges of space, and keep finished work in DIR (a path or a URL). Each worker needs memory"
            " for one range. INPUT may be larger than memory, a URL, or a folder of scenes."),
    ):  # fmt: skip
        command = option(command)
    return command


def advise(count: int) -> None:
    """Warn about the memory that a large scene takes, and name the option that takes less.

    Warns:
        InputWarning: it has more than `LARGE_SCENE` Gaussians.
    """
    if count > LARGE_SCENE:
        message = f"encoding {count:,} Gaussians in memory takes many gigabytes; --work DIR encodes them in ranges"
        warnings.warn(message, InputWarning, stacklevel=2)


@dataclass(frozen=True)
class Reading:
    """How a source is read.

    Attributes:
        format_id: id of the format; None to detect it from the content.
        sh_degree: spherical harmonics above this degree are dropped; None keeps all.
        drop_invalid: whether Gaussians that cannot be encoded are left out.
    """

    format_id: str | None
    sh_degree: int | None
    drop_invalid: bool


@dataclass(frozen=True)
class OutOfCore:
    """The options of out-of-core encoding: the directory, and who works.

    Attributes:
        work: path or URL of the directory.
        workers: processes.
        cluster: address of a Dask scheduler, or None.
        resume: go on with what is there.
        range_size: Gaussians of a range.
    """

    work: str
    workers: int
    cluster: str | None
    resume: bool
    range_size: int

    @classmethod
    def of(cls, said: dict[str, Any]) -> OutOfCore | None:
        """The options of out-of-core encoding, taken out of `said`; None without --work.

        Raises:
            click.UsageError: an option that needs --work, or two that exclude each other.
        """
        work, workers, cluster, resume, range_size = (said.pop(name) for name in _NAMES)
        if work is None:
            if workers or cluster or resume or range_size:
                raise click.UsageError("--workers, --cluster, --resume and --range-size need --work")
            return None
        if said["viewpoints"]:
            raise click.UsageError("--viewpoints and --work exclude each other: --work writes no streaming gains")
        if workers and cluster:
            raise click.UsageError("--workers and --cluster exclude each other")
        return cls(work, workers or 1, cluster, resume, range_size or DEFAULT_RANGE)

    def encode(
        self, name: str, output: str, reading: Reading, options: EncodeOptions, force: bool, quiet: bool
    ) -> Quality:
        """Write the file and report its size; returns the quality of its pictures.

        Raises:
            InvalidInput: the input, the options or the directory are refused.
        """
        if name == STANDARD:
            raise click.UsageError("--work needs an INPUT that can be read again, not -")
        from reference_encoder.scale.executor import workers
        from reference_encoder.scale.run import Job, encode_job
        from reference_encoder.scale.work import Work

        job = Job(
            name, Work(self.work), options, __version__, self.range_size,
            sh_degree=reading.sh_degree, drop_invalid=reading.drop_invalid, format_id=reading.format_id,
            resume=self.resume,
        )  # fmt: skip
        with (
            warnings_on_stderr(quiet),
            _output(output, force) as target,
            progress(quiet) as report,
            _going_on(self.work),
            workers(self.workers, self.cluster) as found,
        ):
            done = encode_job(job, found, target, report, _teller(quiet))
        if not quiet:
            click.echo(f"{done.count:,} Gaussians in, {done.file_bytes:,} bytes, "
                       f"{done.file_bytes / done.count:.2f} per Gaussian of the input", err=True)  # fmt: skip
        return done.quality


def _teller(quiet: bool) -> Callable[[str], None]:
    """Prints lines where no bar is drawn."""
    if quiet or (sys.stderr is not None and sys.stderr.isatty()):
        return lambda _line: None
    return lambda line: click.echo(line, err=True)


@contextmanager
def _going_on(work: str) -> Iterator[None]:
    """If the work is interrupted, report how to continue it."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit):
        click.echo(f"finished work is kept in {work}: the same command with --resume continues", err=True)
        raise


@contextmanager
def _output(name: str, force: bool) -> Iterator[BinaryIO]:
    """The file to write, at a path or a URL."""
    from reference_encoder.scale.places import exists, is_url
    from reference_encoder.scale.work import Work

    if not is_url(name):
        with open_output(name, force) as target:
            yield target
        return
    if not force and exists(name):
        raise InvalidInput("output-exists", f"{name} exists; choose another name, or use --force to overwrite it")
    folder, _, bare = name.rpartition("/")
    with Work(folder).write(bare) as target:
        yield target

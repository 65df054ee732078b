"""`scarfmt encode --work`: encodes scenes larger than memory, in ranges, with several workers."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import click

from reference_encoder.options import DEFAULT_RANGE, MIN_RANGE
from scarfmt import __version__
from scarfmt.cli.files import STANDARD, open_output
from scarfmt.cli.inputs import RENDER_MODELS
from scarfmt.cli.options import with_options
from scarfmt.cli.progress import progress
from scarfmt.errors import InputWarning, InvalidInput

if TYPE_CHECKING:
    from reference_encoder.options import EncodeOptions
    from reference_encoder.out_of_core.run import Done

LARGE_SCENE = 4_000_000
"""Gaussians of which encoding in memory takes about 5 GB at effort 1 and 20 GB at effort 2."""

_NAMES = ("work", "workers", "cluster", "resume", "range_size")

out_of_core_options = with_options(
    click.option("--work", metavar="DIR",
        help="Encode in ranges of space, and keep finished work in DIR (a path or a URL). Each worker needs memory"
        " for one range. INPUT may be larger than memory, a URL, or a folder of scenes."),
    click.option("--workers", type=click.IntRange(1), metavar="N",
        help="With --work: number of processes [default: 1]."),
    click.option("--cluster", metavar="ADDRESS",
        help="With --work: address of a Dask scheduler whose workers encode. All must reach INPUT and DIR."),
    click.option("--resume", is_flag=True,
        help="With --work: continue an interrupted encode from DIR. The result is the same."),
    click.option("--range-size", type=click.IntRange(MIN_RANGE), metavar="N",
        help="With --work: number of Gaussians in a range. A worker needs memory for one range"
        f" [default: {DEFAULT_RANGE}]."),
)  # fmt: skip
"""The options of which :class:`OutOfCore` is made."""


def advise(count: int) -> None:
    """Warn about the memory that a large scene takes, and name the option that takes less.

    Warns:
        InputWarning: it has more than `LARGE_SCENE` Gaussians.
    """
    if count > LARGE_SCENE:
        message = f"encoding {count:,} Gaussians in memory takes many gigabytes; --work DIR encodes them in ranges"
        warnings.warn(message, InputWarning, stacklevel=2)


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
        if workers and cluster:
            raise click.UsageError("--workers and --cluster exclude each other")
        return cls(work, workers or 1, cluster, resume, range_size or DEFAULT_RANGE)

    def encode(
        self, name: str, output: str, reading: Mapping[str, Any], options: EncodeOptions, force: bool, quiet: bool
    ) -> Done:
        """Write the file; returns its size and the quality of its pictures.

        Args:
            name, output, options, force, quiet: as given to the command.
            reading: how the source is read, as :func:`scarfmt.cli.inputs.read_scene` takes it.

        Raises:
            InvalidInput: the input, the options or the directory are refused.
        """
        if name == STANDARD:
            raise click.UsageError("--work needs an INPUT that can be read again, not -")
        _check_apart(self.work, name, output)
        from reference_encoder.out_of_core.run import SHARES, Job, encode_job
        from reference_encoder.out_of_core.work_dir import WorkDir
        from reference_encoder.out_of_core.workers import open_workers

        job = Job(
            name, WorkDir(self.work), options, __version__, self.range_size, resume=self.resume,
            **{**reading, "render_model": RENDER_MODELS.get(reading["render_model"])},
        )  # fmt: skip
        with (
            _output(output, force) as target,
            progress(quiet, SHARES) as report,
            _going_on(self.work),
            open_workers(self.workers, self.cluster) as workers,
        ):
            return encode_job(job, workers, target, report)


def _check_apart(work: str, *names: str) -> None:
    """Refuse an input or an output inside the directory of the work, which would write over it.

    Raises:
        InvalidInput: ``output-path``.
    """
    for name in names:
        if "://" not in work and "://" not in name and Path(name).resolve().is_relative_to(Path(work).resolve()):
            raise InvalidInput("output-path", f"{name} lies in {work}: give another directory to --work")


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
    from reference_encoder.out_of_core.work_dir import WorkDir, exists, is_url

    if not is_url(name):
        with open_output(name, force) as target:
            yield target
        return
    if not force and exists(name):
        raise InvalidInput("output-exists", f"{name} exists")
    folder, _, bare = name.rpartition("/")
    with WorkDir(folder).write(bare) as target:
        yield target

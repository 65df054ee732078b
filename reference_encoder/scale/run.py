"""Encoding a scene larger than memory: every step of :mod:`reference_encoder.scale.steps`, on all ranges, in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, BinaryIO, TypeVar

from reference_encoder.decide.lattice import usual_tile
from reference_encoder.judge.quality import Quality
from reference_encoder.judge.views import Sight
from reference_encoder.options import DEFAULT_RANGE, EncodeOptions
from reference_encoder.scale import tasks
from reference_encoder.scale.bins import write_index
from reference_encoder.scale.claim import claimed
from reference_encoder.scale.cut import cut
from reference_encoder.scale.estimate import Estimate
from reference_encoder.scale.executor import Workers
from reference_encoder.scale.fit import Fit
from reference_encoder.scale.fitted import settled
from reference_encoder.scale.glance import check_options
from reference_encoder.scale.journal import Journal, begin, plan_of
from reference_encoder.scale.judged import quality_of
from reference_encoder.scale.merge import write_file
from reference_encoder.scale.scan import (
    DEEPER,
    DEPTH,
    add_counts,
    bounds_of,
    count_chunk,
    counts_in,
    crowded,
    divided,
    first_cells,
    scan_chunk,
)
from reference_encoder.scale.source import CHUNK_ROWS, Chunk, inputs_of
from reference_encoder.scale.steps import Bounds, Judged, Range
from reference_encoder.scale.work import Work
from scarfmt.arrays import I64, U64
from scarfmt.coding.writer import Report, silent
from scarfmt.errors import missing_package

TOGETHER = 32
"""Counts or histograms that one task adds up."""

SHARES = {
    "scan": 0.02,
    "count": 0.005,
    "bin": 0.03,
    "glance": 0.045,
    "overlook": 0.001,
    "measure": 0.38,
    "pictures": 0.03,
    "fit": 0.018,
    "judge": 0.05,
    "quality": 0.045,
    "apply": 0.3,
    "train": 0.001,
    "histograms": 0.11,
    "reduce": 0.008,
    "code": 0.06,
    "merge": 0.0015,
}
"""Part of the time that each step takes of ten million Gaussians at effort 1. Predictors are not trained there, and
symbols counted in `apply`: the shares of these two steps are those of effort 2."""
ONLY_TRAINED = ("train", "histograms")
"""Steps that there are only where predictors are trained."""

T = TypeVar("T")


@dataclass(frozen=True)
class Job:
    """A job of an out-of-core encoder: what to encode, and how.

    Attributes:
        origin: path or URL of the scene.
        work: directory for what is kept between steps.
        options: of the encoder; `cameras`, too.
        version: of this package: work of another is not gone on with.
        range_size: Gaussians of a range, about.
        chunk_rows: Gaussians of a chunk that is read at once, where they can be chosen.
        sh_degree: bands above are dropped; None for none.
        drop_invalid: leave out Gaussians that cannot be encoded.
        format_id: of the source; None for what its content says.
        resume: go on with what has been done in the work directory.
    """

    origin: str
    work: Work
    options: EncodeOptions
    version: str
    range_size: int = DEFAULT_RANGE
    chunk_rows: int = CHUNK_ROWS
    sh_degree: int | None = None
    drop_invalid: bool = False
    format_id: str | None = None
    resume: bool = False


@dataclass(frozen=True)
class Done:
    """The outcome of a job.

    Attributes:
        quality: of the file, from views that nothing was decided by, as far as some ranges tell it.
        count: Gaussians of the source that can be encoded.
        file_bytes: of the file.
    """

    quality: Quality
    count: int
    file_bytes: int


def encode_job(
    job: Job, workers: Workers, target: BinaryIO, report: Report = silent, tell: Callable[[str], None] = lambda _: None
) -> Done:
    """Write the file of a scene. The same job gives the same bytes, whoever works, and however often it is resumed.

    Args:
        job: what to do.
        workers: who does it.
        target: opened for writing in binary mode.
        report: told (what is done now, part of everything that is done).
        tell: told a line for people, now and then.

    Raises:
        InvalidInput: what the source, the options or the work directory are refused for; ``work-in-use``,
            ``work-full``, ``work-lost``.
        Whatever is raised, the same job with `resume` goes on.
    """
    check_options(job.options)
    if job.options.needs_torch and find_spec("torch") is None:
        raise missing_package("torch", "neural")
    inputs = inputs_of(job.origin, job.chunk_rows, job.format_id)
    settings = {"range": job.range_size, "chunk": job.chunk_rows, "sh": job.sh_degree, "drop": job.drop_invalid}
    plan = plan_of(version=job.version, options=job.options, source=inputs.versions, settings=settings)
    trains = job.options.trains_networks
    shares = {step: share for step, share in SHARES.items() if trains or step not in ONLY_TRAINED}
    with claimed(job.work):
        begin(job.work, plan, job.resume)
        for folder in tasks.FOLDERS:
            job.work.tidy(folder)
        return _Chain(job, Journal(job.work, workers), Estimate(shares, report, tell)).run(inputs.chunks, target)


@dataclass(frozen=True)
class _Chain:
    """The steps of a job."""

    job: Job
    journal: Journal
    estimate: Estimate

    @property
    def work(self) -> Work:
        return self.job.work

    def run(self, chunks: Sequence[Chunk], target: BinaryIO) -> Done:
        scans = self._each("scan", scan_chunk, [(chunk,) for chunk in chunks])
        bounds = bounds_of(scans, self.job.drop_invalid, self.job.sh_degree)
        clean = not any(scan.unusable for scan in scans)
        ranges = self._ranges(chunks, bounds, clean)
        numbers = range(len(ranges))
        if tasks.SCENE not in self.work.names():
            self.work.put(tasks.SCENE, tasks.Scene(bounds, ranges, len(chunks), clean, self.job.options))
        write_index(self.work, self._each("bin", tasks.bin_rows, [(self.work, chunk) for chunk in chunks]))
        self._each("glance", tasks.glance_range, [(self.work, number) for number in numbers])
        [judging] = self._each("overlook", tasks.overlook_scene, [(self.work,)])
        self._each("measure", tasks.measure_range, [(self.work, number) for number in numbers])
        fit = self._fit(judging)
        quality = self._quality(judging)
        anchors = self._each("apply", tasks.apply_range, [(self.work, number) for number in numbers])
        if self.job.options.trains_networks:
            self._each("train", tasks.train_scene, [(self.work, len(ranges), sum(anchors))])
            self._each("histograms", tasks.count_symbols, [(self.work, number) for number in numbers])
        self._reduce(len(ranges), quality)
        rows = self._each("code", tasks.code_range, [(self.work, number) for number in numbers])
        self.estimate.begin("merge")
        size = write_file(self.work, fit.fields, self.work.get(tasks.MODELS), rows, target)
        self.estimate.end("merge", 1)
        return Done(quality, bounds.count, size)

    def _each(self, step: str, function: Callable[..., T], calls: Sequence[tuple[Any, ...]], name: str = "") -> list[T]:
        """Results of a step's tasks, in order.

        Args:
            step: one of `SHARES`.
            function, calls: the tasks.
            name: what marks are called, where a step has several kinds of task.
        """
        self.estimate.begin(step)
        found: dict[int, T] = {}
        now = 0
        for number, result, is_new in self.journal.results(name or step, function, calls):
            found[number] = result
            now += is_new
            self.estimate.done(step, now, len(calls) - len(found))
        self.estimate.end(step, now)
        return [found[number] for number in range(len(calls))]

    def _ranges(self, chunks: Sequence[Chunk], bounds: Bounds, clean: bool) -> tuple[Range, ...]:
        cells = first_cells(*self._counts(chunks, (bounds, clean, DEPTH, None)), DEPTH)
        while len(full := crowded(cells, self.job.range_size)):
            depth = int(cells.depth.max()) + DEEPER
            cells = divided(cells, *self._counts(chunks, (bounds, clean, depth, full)))
        return cut(cells, self.job.range_size, self.job.options.tile_anchors or usual_tile(bounds.count))

    def _counts(self, chunks: Sequence[Chunk], how: tuple[Bounds, bool, int, U64 | None]) -> tuple[U64, I64]:
        """Counts of all chunks in cells of a depth; `how` are the last arguments of `count_chunk`."""
        depth = how[2]
        names = [tasks.numbered(f"counts-{depth}", chunk.number) for chunk in chunks]
        calls = [(self.work, *one, *how) for one in zip(names, chunks, strict=True)]
        self._each("count", count_chunk, calls, f"count-{depth}")
        while len(names) > TOGETHER:
            groups = [names[first : first + TOGETHER] for first in range(0, len(names), TOGETHER)]
            level = f"sums-{depth}-{len(groups)}"
            names = [tasks.numbered(level, number) for number in range(len(groups))]
            calls_of = [(self.work, name, group) for name, group in zip(names, groups, strict=True)]
            self._each("count", add_counts, calls_of, level)
        return counts_in(self.work, names)

    def _fit(self, judging: Sequence[int]) -> Fit:
        """Decide for the whole scene."""
        self._each("pictures", tasks.picture_range, [(self.work, number, Sight.LOOP) for number in judging])
        if tasks.FIT not in self.work.names():
            tries = 0

            def judged(fit: Fit) -> Sequence[Judged]:
                nonlocal tries
                tries += 1
                name = tasks.numbered("fits", tries)
                self.work.put(name, fit)
                found = self._judged(judging, name, Sight.LOOP, f"judge-{tries}", "judge")
                self.estimate.begin("fit")
                return found

            self.estimate.begin("fit")
            fit = settled(self.work.get(tasks.OVERVIEW), tasks.samples_of(self.work), judged)
            self.work.put(tasks.FIT, fit)
            self.estimate.end("fit", 1)
        found: Fit = self.work.get(tasks.FIT)
        return found

    def _judged(self, judging: Sequence[int], fit: str, sight: Sight, name: str, step: str) -> list[Judged]:
        return self._each(step, tasks.judge_range, [(self.work, number, fit, sight) for number in judging], name)

    def _quality(self, judging: Sequence[int]) -> Quality:
        """Quality of pictures from views that nothing was decided by."""
        calls = [(self.work, number, Sight.REPORT) for number in judging]
        self._each("quality", tasks.picture_range, calls, "pictures-report")
        judged = self._judged(judging, tasks.FIT, Sight.REPORT, "judge-report", "quality")
        return quality_of(self.work.get(tasks.OVERVIEW), judged, Sight.REPORT)

    def _reduce(self, ranges: int, quality: Quality) -> None:
        """Models of the file."""
        groups = [range(first, min(first + TOGETHER, ranges)) for first in range(0, ranges, TOGETHER)]
        names = [tasks.numbered("sums", number) for number in range(len(groups))]
        calls = [(self.work, name, group) for name, group in zip(names, groups, strict=True)]
        self._each("reduce", tasks.add_histograms, calls, "sums")
        self._each("reduce", tasks.reduce_scene, [(self.work, names, {"quality": quality.figures()})])

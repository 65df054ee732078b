"""Encoding a scene larger than memory: every step of :mod:`reference_encoder.out_of_core.types`, in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, BinaryIO, TypeVar

import numpy as np

from reference_encoder.importance.view_sampling import ViewSet
from reference_encoder.judge.quality import Quality
from reference_encoder.options import DEFAULT_RANGE, EncodeOptions
from reference_encoder.out_of_core import tasks
from reference_encoder.out_of_core.bins import write_index
from reference_encoder.out_of_core.code import add_blocks, write_file
from reference_encoder.out_of_core.fit import Fit
from reference_encoder.out_of_core.fit_scene import fit_scene
from reference_encoder.out_of_core.judge import combine_quality
from reference_encoder.out_of_core.overview import Overview
from reference_encoder.out_of_core.scan import (
    DEEPER,
    DEPTH,
    bounds_of,
    count_chunk,
    counts_in,
    divide,
    find_crowded,
    first_cells,
    partition,
    scan_chunk,
)
from reference_encoder.out_of_core.source import CHUNK_ROWS, Chunk, Inputs, find_inputs
from reference_encoder.out_of_core.types import Bounds, Range
from reference_encoder.out_of_core.work_dir import WorkDir, describe, file_name
from reference_encoder.out_of_core.workers import Workers
from reference_encoder.rdo.lattice import default_tile_size
from scarfmt.arrays import F64, I64, U64
from scarfmt.coding.writer import Report, silent
from scarfmt.container.registries import RenderModel

SHARES = {
    "scan": 0.02,
    "count": 0.005,
    "bin": 0.03,
    "summarise": 0.045,
    "overview": 0.001,
    "measure": 0.38,
    "pictures": 0.03,
    "fit": 0.018,
    "judge": 0.05,
    "quality": 0.045,
    "apply": 0.3,
    "reduce": 0.008,
    "code": 0.06,
    "opening": 0.001,
    "merge": 0.0015,
}
"""Part of the time that each step takes of ten million Gaussians at effort 1, in the order of the steps."""

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
        render_model: of the source; None for what it says.
        resume: go on with what has been done in the work directory.
    """

    origin: str
    work: WorkDir
    options: EncodeOptions
    version: str
    range_size: int = DEFAULT_RANGE
    chunk_rows: int = CHUNK_ROWS
    sh_degree: int | None = None
    drop_invalid: bool = False
    format_id: str | None = None
    render_model: RenderModel | None = None
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


def encode_job(job: Job, workers: Workers, target: BinaryIO, report: Report = silent) -> Done:
    """Write the file of a scene. The same job gives the same bytes, whoever works, and however often it is resumed.

    Args:
        target: opened for writing in binary mode.
        report: takes (one of `SHARES`, part of it that is done, 0..1).

    Raises:
        InvalidInput: what the source, the options or the work directory are refused for; ``work-in-use``,
            ``work-full``, ``work-lost``.
        Whatever is raised, the same job with `resume` goes on.
    """
    inputs = find_inputs(job.origin, job.chunk_rows, job.format_id)
    settings = {"range": job.range_size, "chunk": job.chunk_rows, "sh": job.sh_degree, "drop": job.drop_invalid}
    settings["model"] = job.render_model
    parts = {"version": job.version, "options": job.options, "source": inputs.versions, "settings": settings}
    plan = {"numpy": np.__version__, **describe(parts)}
    with job.work.lock():
        job.work.begin(plan, job.resume)
        job.work.remove_unfinished()
        return _Chain(job, workers, report).run(inputs, target)


@dataclass(frozen=True)
class _Chain:
    """The steps of a job."""

    job: Job
    workers: Workers
    report: Report

    @property
    def work(self) -> WorkDir:
        return self.job.work

    def run(self, inputs: Inputs, target: BinaryIO) -> Done:
        chunks, model = inputs.chunks, self.job.render_model
        description = inputs.description if model is None else replace(inputs.description, render_model=model)
        scans = self._each("scan", scan_chunk, [(chunk,) for chunk in chunks])
        bounds = replace(bounds_of(scans, self.job.drop_invalid, self.job.sh_degree), description=description)
        clean = not any(scan.unusable for scan in scans)
        ranges = self._ranges(chunks, bounds, clean)
        numbers = range(len(ranges))
        if tasks.SCENE not in self.work.names():
            self.work.put(tasks.SCENE, tasks.Scene(bounds, ranges, len(chunks), clean, self.job.options))
        write_index(self.work, self._each("bin", tasks.bin_rows, [(self.work, chunk) for chunk in chunks]))
        self._each("summarise", tasks.summarise_range, [(self.work, number) for number in numbers])
        [judging_ranges] = self._each("overview", tasks.build_overview, [(self.work,)])
        self._each("measure", tasks.measure_range, [(self.work, number) for number in numbers])
        fit = self._fit(judging_ranges)
        quality = self._quality(judging_ranges)
        self._each("apply", tasks.apply_range, [(self.work, number) for number in numbers])
        metadata = {"quality": quality.figures(), **bounds.description.metadata()}
        self._each("reduce", tasks.build_models, [(self.work, metadata)])
        rows = self._each("code", tasks.code_range, [(self.work, number) for number in numbers])
        models = self.work.get(tasks.MODELS)
        size = sum(int(each.stream_bytes.sum()) for each in rows) + sum(len(block.payload) for block in models.blocks)
        [blocks] = self._each("opening", tasks.make_opening_blocks, [(self.work, size)])
        self.report("merge", 0.0)
        size = write_file(self.work, fit.fields, add_blocks(models, blocks), rows, target)
        return Done(quality, bounds.count, size)

    def _each(self, step: str, function: Callable[..., T], calls: Sequence[tuple[Any, ...]], name: str = "") -> list[T]:
        """Results of a step's tasks, in order.

        Args:
            step: one of `SHARES`.
            name: of the folder of their results, where a step has several kinds of task.
        """
        self.report(step, 0.0)
        found: dict[int, T] = {}
        for number, result in self.workers.results_once(self.work, name or step, function, calls):
            found[number] = result
            self.report(step, len(found) / len(calls))
        return [found[number] for number in range(len(calls))]

    def _ranges(self, chunks: Sequence[Chunk], bounds: Bounds, clean: bool) -> tuple[Range, ...]:
        cells = first_cells(*self._counts(chunks, (bounds, clean, DEPTH, None)), DEPTH)
        while len(full := find_crowded(cells, self.job.range_size)):
            depth = int(cells.depth.max()) + DEEPER
            cells = divide(cells, *self._counts(chunks, (bounds, clean, depth, full)))
        return partition(cells, self.job.range_size, self.job.options.tile_anchors or default_tile_size(bounds.count))

    def _counts(self, chunks: Sequence[Chunk], how: tuple[Bounds, bool, int, U64 | None]) -> tuple[U64, I64]:
        """Counts of all chunks in cells of a depth; `how` are the last arguments of `count_chunk`."""
        depth = how[2]
        names = [file_name(f"counts-{depth}", chunk.number) for chunk in chunks]
        calls = [(self.work, *one, *how) for one in zip(names, chunks, strict=True)]
        self._each("count", count_chunk, calls, f"count-{depth}")
        return counts_in(self.work, names)

    def _fit(self, judging_ranges: Sequence[int]) -> Fit:
        """Decide for the whole scene."""
        self._each("pictures", tasks.render_range, [(self.work, number, ViewSet.TUNING) for number in judging_ranges])
        if tasks.FIT not in self.work.names():
            tries = 0

            def judge(fit: Fit) -> Sequence[F64]:
                nonlocal tries
                tries += 1
                name = file_name("fits", tries)
                self.work.put(name, fit)
                return self._judge(judging_ranges, name, ViewSet.TUNING, f"judge-{tries}", "judge")

            self.report("fit", 0.0)
            overview: Overview = self.work.get(tasks.OVERVIEW)
            samples = [self.work.get(file_name("samples", number)) for number in range(len(overview.edges) - 1)]
            fit = fit_scene(overview, samples, judge)
            self.work.put(tasks.FIT, fit)
        found: Fit = self.work.get(tasks.FIT)
        return found

    def _judge(self, judging_ranges: Sequence[int], fit: str, view_set: ViewSet, name: str, step: str) -> list[F64]:
        calls = [(self.work, number, fit, view_set) for number in judging_ranges]
        return self._each(step, tasks.judge_range, calls, name)

    def _quality(self, judging_ranges: Sequence[int]) -> Quality:
        """Quality of pictures from views that nothing was decided by."""
        calls = [(self.work, number, ViewSet.HELD_OUT) for number in judging_ranges]
        self._each("quality", tasks.render_range, calls, "pictures-report")
        judged = self._judge(judging_ranges, tasks.FIT, ViewSet.HELD_OUT, "judge-report", "quality")
        return combine_quality(self.work.get(tasks.OVERVIEW), judged, ViewSet.HELD_OUT)

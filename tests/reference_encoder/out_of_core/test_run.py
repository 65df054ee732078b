"""A job gives the same bytes whoever works, whoever dies, and however often it is restarted; it predicts its time."""

from __future__ import annotations

import io
import os
import signal
import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from reference_encoder.options import EncodeOptions
from reference_encoder.out_of_core.run import SHARES, Job, encode_job
from reference_encoder.out_of_core.work_dir import WorkDir
from reference_encoder.out_of_core.workers import open_workers
from scarfmt.blocks.streaming import read_streaming
from scarfmt.container.file import Container
from scarfmt.container.source import BytesSource
from scarfmt.render.camera import look_at
from scarfmt.tools.validate import validate
from tests.reference_encoder.out_of_core.scenes import clusters, ply_of
from tests.samples.codec_samples import refuses

EYES = [np.array([6 * np.cos(angle), 2.0, 6 * np.sin(angle)]) for angle in (0.0, 1.5, 3.0, 4.5)]
CAMERAS = [look_at(eye, np.zeros(3), np.array([0.0, 1.0, 0.0]), 96, 72) for eye in EYES]
OPTIONS = EncodeOptions(
    effort=1, corrections=1, layers=2, quality=38.0, tile_anchors=1024, cameras=CAMERAS, only_cameras=True
)


def job_in(folder: Path, origin: str, **changes: Any) -> Job:
    job = Job(origin, WorkDir(str(folder / "work")), OPTIONS, "0", range_size=1200, chunk_rows=700)
    return replace(job, **changes)


def encoded(job: Job, count: int = 1, cluster: str | None = None, **changes: Any) -> bytes:
    target = io.BytesIO()
    with open_workers(count, cluster) as found:
        done = encode_job(job, found, target, **changes)
    assert done.file_bytes == len(target.getvalue())
    return target.getvalue()


@pytest.fixture(scope="module")
def origin(tmp_path_factory: pytest.TempPathFactory) -> str:
    return ply_of(clusters(4000), tmp_path_factory.mktemp("source"))


@pytest.fixture(scope="module")
def expected(origin: str, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Made by one process, without interruption."""
    return encoded(job_in(tmp_path_factory.mktemp("serial"), origin))


def test_the_file_is_sound_and_holds_the_scene(expected: bytes) -> None:
    found = validate(BytesSource(expected))
    assert found.valid, found.findings
    header = Container(BytesSource(expected)).header
    assert header.fields.source_count == 4000
    assert header.tile_count >= 4
    assert 1000 < header.anchor_count <= 4000


def test_the_file_opens_from_one_of_the_cameras(expected: bytes) -> None:
    """And tells of each tile where its content is."""
    container = Container(BytesSource(expected))
    streaming = read_streaming(container)
    assert streaming is not None
    assert streaming.tiles == container.header.tile_count
    assert streaming.view is not None
    assert min(np.linalg.norm(streaming.view.position - eye) for eye in EYES) < 1e-5


def test_a_draft_needs_no_survey(origin: str, tmp_path: Path) -> None:
    options = EncodeOptions(effort=0, layers=2, quality=38.0, tile_anchors=1024)
    data = encoded(job_in(tmp_path, origin, options=options))
    assert validate(BytesSource(data)).valid
    assert Container(BytesSource(data)).header.anchor_count > 1000


def test_two_processes_make_the_same_bytes(origin: str, expected: bytes, tmp_path: Path) -> None:
    assert encoded(job_in(tmp_path, origin), 2) == expected


@pytest.mark.slow
def test_chunks_of_another_size_make_the_same_bytes(origin: str, expected: bytes, tmp_path: Path) -> None:
    """How the source is read decides nothing."""
    assert encoded(job_in(tmp_path, origin, chunk_rows=10_000)) == expected


class Stop(BaseException):
    """Ends the work as an interrupt does."""


class Stopper:
    """Ends the work when some of a step is done, once in each step."""

    def __init__(self) -> None:
        self.seen: set[str] = set()

    def report(self, step: str, part: float) -> None:
        if part > 0 and step not in self.seen:
            self.seen.add(step)
            raise Stop


def test_work_that_is_ended_in_every_step_goes_on_to_the_same_bytes(
    origin: str, expected: bytes, tmp_path: Path
) -> None:
    """Once in each step, and each time begun again in what was left behind, files of a killed process among it."""
    stopper, found = Stopper(), None
    job = job_in(tmp_path, origin)
    while found is None:
        try:
            found = encoded(job, report=stopper.report)
        except Stop:
            job = replace(job, resume=True)
            (tmp_path / "work" / "half-written.0123.part").touch()
    assert found == expected
    assert not list(tmp_path.rglob("*.part"))
    assert stopper.seen == set(SHARES) - {"fit", "merge"}


def test_work_of_another_scene_or_other_options_is_not_gone_on_with(origin: str, tmp_path: Path) -> None:
    """Nor is a directory taken that holds any, unless asked for."""
    job = job_in(tmp_path, origin)
    with pytest.raises(Stop):
        encoded(job, report=Stopper().report)
    changed = {
        "work-exists": [job],
        "work-plan": [
            replace(job, resume=True, options=replace(OPTIONS, quality=39.0)),
            replace(job, resume=True, range_size=1300),
            replace(job, resume=True, version="1"),
            replace(job, resume=True, origin=ply_of(clusters(4000, seed=1), tmp_path)),
        ],
    }
    for refusal, jobs in changed.items():
        for one in jobs:
            refuses(refusal, partial(encoded, one))


@pytest.fixture
def cluster() -> Iterator[Any]:
    """Workers of Dask on this machine, each a process of one thread."""
    distributed = pytest.importorskip("distributed", reason="needs Dask: pip install 'scarfmt[cluster]'")
    with distributed.LocalCluster(
        n_workers=3, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=0
    ) as found:
        yield found


def test_a_cluster_makes_the_same_bytes_though_a_worker_is_killed(
    cluster: Any, origin: str, expected: bytes, tmp_path: Path
) -> None:
    """One of three, in the middle; the tasks it had are done by others."""
    victims = [next(iter(cluster.workers.values())).pid]
    lock = threading.Lock()

    def kill(step: str, part: float) -> None:
        with lock:
            if step == "measure" and part > 0 and victims:
                os.kill(victims.pop(), signal.SIGKILL)

    assert encoded(job_in(tmp_path, origin), cluster=cluster.scheduler_address, report=kill) == expected
    assert not victims

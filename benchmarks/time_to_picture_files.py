"""Whose files are set against each other for the time to a picture, and how each is read.

Of a rival's settings the smallest file counts whose mean over the judged views is good enough: that was found by
`benchmarks.rivals_run`, whose results are read here. Its file is written again where it is not kept.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks import child
from benchmarks.encoded import encoded
from benchmarks.quality import distortion
from benchmarks.rivals_formats import Format, formats
from benchmarks.rivals_read import OURS as IMPORTER
from benchmarks.rivals_read import readers, reading
from benchmarks.rivals_run import source_ply, written
from benchmarks.rivals_tools import ToolFailed, splat_transform
from benchmarks.scenes import Scene
from reference_decoder.decode import decode_scene
from scarfmt.cli.scenes import load_subject

GOALS = (25.0, 41.0)
"""A first picture, and a good one: mean PSNR over the judged views, dB."""
FIRST, GOOD = GOALS
SCAR = "scar"
SETTINGS: dict[str, dict[str, Any]] = {"default": {}, "static": {"decode_budget": 0}, "archive": {"archive": True}}
"""Options of the encoder, by name."""
FAMILIES = {"spz": "SPZ", "sog": "SOG", "compressed-ply": "compressed.ply"}
SLOW_SECONDS = 600.0
"""A SOG that took longer to write is written with one iteration of k-means: as good a file to time a reader with."""
CORES = {"one": 1, "all": os.cpu_count() or 1}
RUNS, SECONDS = 5, 3.0
Record = dict[str, Any]


@dataclass(frozen=True)
class Way:
    """A picture of some quality from a file.

    Attributes:
        family: `SCAR`, or one of `FAMILIES`.
        name: as tables show it.
        goal: one of `GOALS`, dB.
        size: bytes that must arrive.
        psnr_db: mean over the judged views.
        file: what is read to time it.
        layers: of ours, how many; 0 for a rival.
        scale: a rival's scene was enlarged by this much.
        note: what a reader of the table should know.
    """

    family: str
    name: str
    goal: float
    size: int
    psnr_db: float
    file: Path
    layers: int = 0
    scale: float = 1.0
    note: str = ""

    def record(self) -> Record:
        """The record of a file in the results."""
        told = {"family": self.family, "name": self.name, "goal": self.goal, "bytes": self.size}
        return {**told, "psnr_db": self.psnr_db, "layers": self.layers, "note": self.note}

    def jobs(self) -> Iterator[tuple[str, str, child.Job]]:
        """(cores, reader, job) for each way to time it."""
        for cores, count in CORES.items():
            for reader in [SCAR] if self.layers else readers(self.file):
                job = {"job": "benchmarks.time_to_picture_files:read_job", "file": str(self.file), "reader": reader}
                threads = {"NUMBA_NUM_THREADS": str(count)}
                more = {"cores": count, "layers": self.layers, "scale": self.scale, "environment": threads}
                yield cores, reader, {**job, **more}


def ours(scene: Scene, quality: float, effort: int, settings: Sequence[str]) -> list[Way]:
    """The first layers that reach each of `GOALS`, or all layers for the last, of a file of each setting."""
    found = []
    for setting in settings:
        path = Path(encoded(scene, quality, effort, **SETTINGS[setting])["path"])
        layers = distortion(scene, path)["layers"]
        levels = [layer["psnr_db"] for layer in layers]
        first = next((number for number, level in enumerate(levels, 1) if level >= FIRST), len(layers))
        for goal, number in zip(GOALS, (first, len(layers)), strict=True):
            last = layers[number - 1]
            note = (
                "" if last["psnr_db"] >= goal else f"{last['psnr_db']:.1f} dB, less than the {goal:g} dB of the others"
            )
            found.append(Way(SCAR, setting, goal, last["bytes"], last["psnr_db"], path, number, note=note))
    return found


def chosen_rivals(rivals: Sequence[Record], families: Sequence[str]) -> list[tuple[float, Record]]:
    """(goal, rival): of each family the smallest that reaches each goal, where one does."""
    found = []
    for goal in GOALS:
        for family in families:
            good = [rival for rival in rivals if rival["family"] == family and rival["psnr_db"] >= goal]
            if good:
                found.append((goal, min(good, key=lambda rival: int(rival["bytes"]))))
    return found


def rivals(scene: Scene, judged: Record, families: Sequence[str]) -> tuple[list[Way], list[str]]:
    """The rivals of a scene, and why others are missing.

    Args:
        scene: what they stand for.
        judged: results of `benchmarks.rivals_run` for the scene.
        families: of them, those wanted.
    """
    gaussians = load_subject(str(scene.path)).placed
    source = source_ply(scene, gaussians)
    known = {each.name: each for each in formats(gaussians)}
    found, missing = [], []
    picked = chosen_rivals(judged["rivals"], families)
    for family in families:
        if not any(goal == GOOD and rival["family"] == family for goal, rival in picked):
            missing.append(f"{scene.name}, {FAMILIES[family]}: no setting measured reaches {GOOD:g} dB")
    for goal, rival in picked:
        way, note = timed_as(known[rival["name"]], rival)
        try:
            path, _ = written(scene, source, way, False)
        except ToolFailed as error:
            missing.append(f"{scene.name}, {rival['name']}: {error}")
            continue
        facts = goal, rival["bytes"], rival["psnr_db"], path
        found.append(Way(rival["family"], rival["name"], *facts, scale=way.scale, note=note))
    return found, missing


def timed_as(way: Format, judged: Record) -> tuple[Format, str]:
    """The format a rival is timed with, and what to say of that: its own unless writing takes too long."""
    if way.family != "sog" or judged["encode_seconds"] <= SLOW_SECONDS:
        return way, ""
    quick = replace(way, command=lambda source, out: splat_transform(str(source), "--sh-iterations", "1", str(out)))
    return quick, "timed with a file of one iteration of k-means"


def read_job(job: Record) -> Record:
    """Child job: time a reader on one core or all, after one read that is not counted."""
    if job["cores"] == 1 and hasattr(os, "sched_setaffinity"):
        # Whatever threads a reader starts share that core.
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    act = _reading(Path(job["file"]), job)
    act()
    return child.timed(act, RUNS, SECONDS)


def _reading(path: Path, job: Record) -> Callable[[], object]:
    if job["reader"] == SCAR:
        return partial(decode_scene, path, threads=job["cores"], layers=job["layers"])
    return reading(path, job["scale"], job["reader"])


def reader_name(reader: str) -> str:
    """The name of a reader in tables."""
    return {SCAR: "this decoder", IMPORTER: "our importer"}.get(reader, reader)

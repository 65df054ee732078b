"""The paper's ablations, trained from photos: each variant a file, measured against the photos that were held out.

    python -m benchmarks.trained_ablations plush-on-bed CAPTURE --resolution 378 --iterations 2000
    python -m benchmarks.trained_ablations plush-on-bed CAPTURE --studies entropy grid --seeds 1 --iterations 500
    python -m benchmarks.trained_ablations bonsai CAPTURE --base paper --iterations 40000 --device cuda
    python -m benchmarks.trained_ablations plush-on-bed CAPTURE --plan      what is done, what is still to do
    python -m benchmarks.trained_ablations --report                         only rewrite docs/trained.md

Trainings run one after another, each in a process of its own (`benchmarks.trained_plan` says which). What is among
the results is not trained again. A training that was killed goes on from its checkpoint, in build/benchmarks/trained/:
delete a folder there to start again. One that fails does not keep back the others. With --slice-minutes the command
leaves off after so many minutes with exit code 75, and the same command goes on. Results are merged into
benchmarks/results/trained-ablations.json by scene and training.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks import child, provenance
from benchmarks.photos import add_arguments, figures, metrics
from benchmarks.report import SCRATCH, load_document, save_results
from benchmarks.trained_plan import BASES, STUDIES, Training, trainings
from benchmarks.trained_tables import ABLATIONS, ablation_tables, write_ablations
from reference_encoder.training.capture import load_capture
from reference_encoder.training.checkpoints import discard_checkpoints
from reference_encoder.training.log import read_log
from reference_encoder.training.options import DEVICES, LeftOff, Progress, Stop, TrainOptions, never
from reference_encoder.training.recipe import Recipe
from reference_encoder.training.run import train
from scarfmt.atomic import atomic_write
from scarfmt.cli.failures import UNFINISHED

SEEDS = 2
_TELL_SECONDS = 60.0

Record = dict[str, Any]


@dataclass(frozen=True)
class Place:
    """The place where all trainings of a run read and write.

    Attributes:
        name: of the scene, as results have it.
        capture: what `scarfmt train` takes.
        resolution: longest side of its photos, None for as they are.
        lpips: files of weights.
        scratch: folder for checkpoints and files.
    """

    name: str
    capture: Path
    resolution: int | None
    lpips: tuple[Path, ...]
    scratch: Path

    def folder(self, training: Training) -> Path:
        """The folder of one training."""
        return self.scratch / _stem(self.name) / _stem(training.name)


def _stem(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-.+=" else "_" for c in name)


def train_job(job: dict[str, Any]) -> Record:
    """Job of `benchmarks.child`: train and measure one file; ``left_off`` if its time was over before."""
    capture = load_capture(job["capture"], job["resolution"])
    folder = Path(job["folder"])
    target = folder / "scene.scar"
    if not target.exists():
        options, recipe = TrainOptions(**job["options"]), Recipe(**job["recipe"])
        try:
            made = train(capture, options, folder, _Teller(), leave=_after(job["seconds"]), recipe=recipe)
        except LeftOff as left:
            return {"left_off": str(left)}
        with atomic_write(target) as stream:
            stream.write(made.data)
        discard_checkpoints(folder)
    ended = read_log(folder)[-1]
    photos = list(capture.test)
    rows = figures(target.read_bytes(), photos, metrics([Path(path) for path in job["lpips"]]))
    return {
        "photos": len(photos),
        "size": [photos[0].camera.width, photos[0].camera.height],
        "iterations": ended["iteration"],
        "seconds": round(ended["seconds"], 1),
        "anchors": ended["anchors"],
        "gaussians": ended["gaussians"],
        "layers": [asdict(row) for row in rows],
    }


class _Teller:
    """Says now and then on stderr where a training stands; ends it with the process that started it."""

    def __init__(self) -> None:
        self._told, self._parent = time.monotonic(), os.getppid()

    def __call__(self, now: Progress) -> None:
        if os.getppid() != self._parent:
            # Whoever calls the command again must not find another one at work in the same folder.
            sys.exit("the campaign was killed")
        if time.monotonic() - self._told > _TELL_SECONDS:
            self._told = time.monotonic()
            line = f"  {now.phase}, {now.iteration:,} of {now.iterations:,}, {now.seconds_left / 60:.0f} min left"
            print(line, file=sys.stderr, flush=True)


def _after(seconds: float | None) -> Stop:
    """A question that is answered with yes so many seconds from now."""
    if seconds is None:
        return never
    end = time.monotonic() + seconds
    return lambda: time.monotonic() >= end


Start = Callable[..., Record]


def campaign(
    place: Place,
    wanted: Sequence[Training],
    keep: Callable[[str, Record], None],
    seconds: float | None = None,
    start: Start = child.run,
) -> int:
    """Run trainings one after another; an exit status: 0, 1 if one failed, 75 if time was over before the last.

    Args:
        place: what they learn from.
        wanted: which.
        keep: called with the name and the record of each.
        seconds: time for all of them, None for as long as they take.
        start: runs a job of `benchmarks.child`.
    """
    began, failed = time.monotonic(), 0
    for number, training in enumerate(wanted, 1):
        left = None if seconds is None else seconds - (time.monotonic() - began)
        if left is not None and left <= 0:
            return UNFINISHED
        print(f"{number}/{len(wanted)}  {place.name}: {training.name}", file=sys.stderr, flush=True)
        job = {
            "job": "benchmarks.trained_ablations:train_job",
            "capture": str(place.capture),
            "resolution": place.resolution,
            "lpips": [str(path) for path in place.lpips],
            "options": asdict(training.options),
            "recipe": asdict(training.recipe),
            "folder": str(place.folder(training)),
            "seconds": left,
        }
        try:
            record = start(**job)
        except subprocess.CalledProcessError:
            print("  failed: above it says why", file=sys.stderr, flush=True)
            failed = 1
            continue
        if "left_off" in record:
            return UNFINISHED
        keep(training.name, record)
    return failed


def scene_name(said: argparse.Namespace) -> str:
    """The name of a scene among the results; figures of other sizes and lengths are not part of its tables."""
    size = "photos as they are" if said.resolution is None else f"{said.resolution} pixels"
    length = f"{said.iterations:,} iterations" if said.minutes is None else f"{said.minutes:g} minutes"
    return f"{said.scene}, {size}, {length}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", help="name of the capture on the page")
    parser.add_argument("capture", nargs="?", type=Path, help="capture as for `scarfmt train`, with photos held out")
    add_arguments(parser)
    parser.add_argument("--studies", nargs="+", choices=STUDIES, default=list(STUDIES), metavar="NAME")
    parser.add_argument("--base", choices=BASES, default="rvq", help="preset that rows change [default: rvq]")
    parser.add_argument("--seeds", type=int, default=SEEDS, help=f"trainings of each row [default: {SEEDS}]")
    length = parser.add_mutually_exclusive_group()
    length.add_argument("--iterations", type=int, default=2000, help="iterations of each training [default: 2000]")
    length.add_argument("--minutes", type=float, help="minutes of each training, in place of iterations")
    parser.add_argument("--device", choices=DEVICES, default="cpu")
    parser.add_argument("--slice-minutes", type=float, help="stop after so many minutes, with exit code 75")
    parser.add_argument("--plan", action="store_true", help="list the trainings without running them")
    parser.add_argument("--report", action="store_true", help="only rewrite docs/trained.md")
    parser.add_argument("--no-write", action="store_true", help="print the tables; JSON goes to build/bench/ only")
    return parser


def main(arguments: Sequence[str] | None = None, start: Start = child.run) -> int:
    parser = _parser()
    said = parser.parse_args(arguments)
    keep = not said.no_write
    results = provenance.figures(load_document(ABLATIONS, keep))
    if said.report:
        write_ablations(results)
        return 0
    if said.scene is None or said.capture is None:
        parser.error("a scene's name and its capture are needed")
    name = scene_name(said)
    length = {"iterations": said.iterations} if said.minutes is None else {"minutes": said.minutes}
    known = results.get(name, {})
    every = trainings(said.studies, said.base, {**length, "device": said.device}, said.seeds)
    wanted = [training for training in every if training.name not in known]
    if said.plan:
        for training in every:
            print("done " if training.name in known else "to do", training.name)
        return 0

    def store(training: str, record: Record) -> None:
        results.setdefault(name, {})[training] = record
        save_results(ABLATIONS, results, keep, [f"{name}/{training}"])

    weights = tuple(path.absolute() for path in said.lpips)
    place = Place(name, said.capture.absolute(), said.resolution, weights, SCRATCH / "trained")
    status = campaign(place, wanted, store, None if said.slice_minutes is None else 60 * said.slice_minutes, start)
    if keep:
        write_ablations(results)
    else:
        print(ablation_tables(results))
    return status


if __name__ == "__main__":
    sys.exit(main())

"""Time and memory of the encoder's survey against the number of Gaussians, up to four million.

    python -m benchmarks.survey_time                        angel and copies of it: some minutes
    python -m benchmarks.survey_time --short --no-write     the example scene and 4 copies of it, printed

A larger scene is copies of a real one, side by side on the ground, each jittered. Only the survey runs, at effort 1:
no bits are spent. Every figure is of a process of its own. Results are merged into benchmarks/results/survey-time.json;
the table is in docs/scaling.md.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks import child
from benchmarks.report import add_arguments, dated, load_results, replace_section, save_results, table
from benchmarks.scaling import PAGE, slope
from benchmarks.scenes import chosen
from reference_encoder.profiles.explicit import ExplicitProfile
from scarfmt.formats import load
from scarfmt.formats.clean import clean
from scarfmt.render.camera import core, upward_axes
from scarfmt.scene.gaussians import GaussianScene

NAME = "survey-time"
SCENE, COPIES = "angel", (1, 4, 14, 56)
SHORT_SCENE, SHORT_COPIES = "plush-toys", (1, 4)
EFFORT = 1
_SPACING = 2.4
"""Half extents of the core from copy to copy: a little air between them."""


def laid_out(scene: GaussianScene, count: int, up: str, seed: int = 0) -> GaussianScene:
    """A scene `count` times, side by side; positions of all but the first are moved by about a Gaussian's size."""
    random = np.random.default_rng(seed)
    axes = upward_axes(up)
    _, half = core(scene, axes[2])
    columns = int(np.ceil(np.sqrt(count)))
    size = np.exp(scene.log_scales.astype(np.float64)).mean(axis=1, keepdims=True)
    places = []
    for number in range(count):
        ground = (number % columns) * axes[0] + (number // columns) * axes[1]
        moved = random.normal(size=scene.positions.shape) * size if number else 0.0
        places.append(scene.positions + _SPACING * half * ground + moved)
    every = scene.take(np.tile(np.arange(len(scene)), count))
    return replace(every, positions=np.concatenate(places))


def survey_job(job: dict[str, Any]) -> dict[str, Any]:
    """Job of `benchmarks.child`: measure a scene, `copies` times, as the encoder does before it decides anything."""
    place = chosen([job["scene"]])[0]
    source, _ = clean(load(place.path), drop_invalid=True)
    assert isinstance(source, GaussianScene)
    scene = laid_out(source, job["copies"], place.up)
    # What is compiled at first use is not counted.
    ExplicitProfile.measured(source.take(np.arange(min(len(source), 100))), place.options(effort=EFFORT))
    wall, processor = time.perf_counter(), time.process_time()
    ExplicitProfile.measured(scene, place.options(effort=EFFORT))
    seconds, cpu = time.perf_counter() - wall, time.process_time() - processor
    return {"gaussians": len(scene), "seconds": seconds, "cpu": cpu}


def survey_table(results: dict[str, Any]) -> str:
    """Seconds and memory by size, and the slope of a line through log time and log Gaussians."""
    runs = sorted(results.values(), key=lambda run: int(run["gaussians"]))
    rows = [
        [
            run["scene"],
            str(run["copies"]),
            f"{run['gaussians']:,}",
            f"{run['seconds']:.1f}",
            f"{run['cpu']:.1f}",
            f"{1e6 * run['cpu'] / run['gaussians']:.0f}",
            f"{run['peak_bytes'] / 2**20:,.0f}",
        ]
        for run in runs
    ]
    head = ["scene", "copies", "Gaussians", "s", "processor s", "µs a Gaussian", "peak MiB"]
    found = slope([(float(run["gaussians"]), float(run["cpu"])) for run in runs])
    return f"{table(head, rows)}\nSlope of processor time: {found:.2f}; 1 is linear."


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser, scenes=False)
    parser.add_argument("--copies", nargs="+", type=int)
    parser.add_argument("--report", action="store_true", help="measure nothing, rewrite the table")
    arguments = parser.parse_args()
    keep = not arguments.no_write
    name, usual = (SHORT_SCENE, SHORT_COPIES) if arguments.short else (SCENE, COPIES)
    results = load_results(NAME) if keep else {}
    for copies in () if arguments.report else arguments.copies or usual:
        print(f"{name}, {copies} copies", file=sys.stderr, flush=True)
        found = child.run(job="benchmarks.survey_time:survey_job", scene=name, copies=copies)
        results[f"{name} x{copies}"] = {"scene": name, "copies": copies, **found}
        save_results(NAME, results, keep, [f"{name} x{copies}"])
    show = partial(replace_section, NAME, page=PAGE) if keep else print
    show(dated(survey_table(results), NAME, keep))


if __name__ == "__main__":
    main()

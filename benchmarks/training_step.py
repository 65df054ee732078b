"""Milliseconds of the rasteriser's parts in a step of training, beside those of a picture by the other renderer.

    python -m benchmarks.training_step                        a minute; the table is in docs/training.md
    python -m benchmarks.training_step --short --no-write     one small scene, printed

Made-up Gaussians fill a picture of 640x480 pixels, as large as those of trained scenes are in theirs. All parts and the
other renderer take turns, so that ratios hold on a machine that others use; figures are medians of the rounds.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from functools import partial
from statistics import median
from typing import Any

import numpy as np
import torch

from benchmarks import child
from benchmarks.report import add_arguments, dated, load_results, replace_section, save_results, table
from benchmarks.scenes import REPOSITORY
from reference_encoder.training.raster import Gaussians
from reference_encoder.training.raster.composite import composite
from reference_encoder.training.raster.prepare import prepare
from scarfmt.arrays import F64
from scarfmt.render.camera import Camera
from scarfmt.render.projection import Drawable
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import GaussianScene

NAME, PAGE = "training-step", REPOSITORY / "docs" / "training.md"
COUNTS, SHORT_COUNTS, THREADS = (86_000, 100_000), (20_000,), (1, 2)
ROUNDS, SHORT_ROUNDS = 15, 3
CAMERA = Camera(640, 480, 500.0, 500.0, 320.0, 240.0, np.eye(4))
_SIZE, _SPREAD = 0.0035, 0.7
"""Median deviation at unit depth, and that of its logarithm: half the splats reach 5 pixels from their centre."""


def made_up(count: int) -> Gaussians:
    """The given number of visible Gaussians, of all directions and opacities, always the same."""
    generator = torch.Generator().manual_seed(0)

    def uniform(low: float, high: float, *shape: int) -> torch.Tensor:
        return low + (high - low) * torch.rand(*shape, generator=generator)

    z = uniform(2, 8, count)
    centres = torch.stack([uniform(-0.64, 0.64, count) * z, uniform(-0.48, 0.48, count) * z, z], 1)
    scales = _SIZE * (_SPREAD * torch.randn(count, 3, generator=generator)).exp() * z[:, None]
    rotations, logits = torch.randn(count, 4, generator=generator), 2 * torch.randn(count, generator=generator)
    made = centres, scales, rotations, logits.sigmoid(), uniform(0, 1, count, 3)
    return Gaussians(*(one.requires_grad_() for one in made))


def drawable(gaussians: Gaussians) -> tuple[Drawable, F64]:
    """The Gaussians for the renderer that measures, and (N, 3) colours."""
    centres, scales, rotations, opacities, colours = (one.detach() for one in gaussians.tensors())
    positions, log_scales, logits = centres.double().numpy(), scales.log().numpy(), opacities.logit().numpy()
    sh = np.zeros((len(positions), 1, 3), np.float32)
    scene = GaussianScene(positions, log_scales, rotations.numpy(), logits, sh)
    return Drawable.of(scene), colours.double().numpy()


class Parts:
    """Milliseconds of parts, of wall and of processor, round after round."""

    def __init__(self) -> None:
        self.walls: dict[str, list[float]] = {}
        self.cpus: dict[str, list[float]] = {}

    def time(self, name: str, work: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        """The result of `work`; its time is kept under `name`."""
        wall, cpu = time.perf_counter(), time.process_time()
        result = work(*arguments, **options)
        self.walls.setdefault(name, []).append(1e3 * (time.perf_counter() - wall))
        self.cpus.setdefault(name, []).append(1e3 * (time.process_time() - cpu))
        return result

    def medians(self) -> dict[str, dict[str, float]]:
        """The medians of all rounds but the first, which compiles and warms up."""
        found = self.walls, self.cpus
        return {name: {"ms": median(found[0][name][1:]), "cpu_ms": median(found[1][name][1:])} for name in self.walls}


def step_job(job: dict[str, Any]) -> dict[str, Any]:
    """Job of `benchmarks.child`: medians by part over `rounds` of a step with `gaussians` on `threads`."""
    torch.set_num_threads(job["threads"])
    gaussians, background, parts = made_up(job["gaussians"]), torch.zeros(3), Parts()
    inputs = gaussians.centres, gaussians.scales, gaussians.rotations
    towards = torch.randn(CAMERA.height, CAMERA.width, 3, generator=torch.Generator().manual_seed(1))
    scene, colours = drawable(gaussians)
    for _ in range(job["rounds"] + 1):
        prepared = parts.time("projection", prepare, gaussians, CAMERA)
        ends = prepared.means, prepared.ellipses
        image, _ = parts.time("blending", composite, prepared, gaussians, background, CAMERA)
        to_ends = parts.time("gradient of blending", torch.autograd.grad, image, ends, towards, retain_graph=True)
        parts.time("gradient of projection", torch.autograd.grad, ends, inputs, to_ends)
        if job["yardstick"]:
            parts.time("picture by the measuring renderer", render, scene, CAMERA, colours=colours)
    sizes = {"intersections": len(prepared.listing.listed), "shown": len(prepared.which)}
    return {"parts": parts.medians(), **sizes}


def step_table(results: dict[str, Any]) -> str:
    """Milliseconds of processor of the parts of each run: on a machine that others use, those of wall say little."""
    runs = [results[name] for name in sorted(results)]
    head = ["Gaussians", "intersections", "threads"]
    parts = list(dict.fromkeys(name for run in runs for name in run["parts"]))
    rows = []
    for run in runs:
        sizes = [f"{run['gaussians']:,}", f"{run['intersections']:,}", str(run["threads"])]
        found = [run["parts"].get(name) for name in parts]
        figures = [f"{one['cpu_ms']:.0f}" if one else "–" for one in found]
        rows.append([*sizes, *figures, f"{run['peak_bytes'] / 2**20:,.0f}"])
    return table([*head, *parts, "peak MiB"], rows, text_columns=0)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser, scenes=False)
    parser.add_argument("--report", action="store_true", help="measure nothing, rewrite the table")
    arguments = parser.parse_args()
    keep = not arguments.no_write
    counts, rounds = (SHORT_COUNTS, SHORT_ROUNDS) if arguments.short else (COUNTS, ROUNDS)
    results = load_results(NAME) if keep else {}
    for count in () if arguments.report else counts:
        for threads in THREADS:
            print(f"{count:,} Gaussians, {threads} threads", file=sys.stderr, flush=True)
            job = {"gaussians": count, "threads": threads, "rounds": rounds, "yardstick": threads == THREADS[-1]}
            environment = {"OMP_NUM_THREADS": str(threads), "NUMBA_NUM_THREADS": str(threads)}
            found = child.run(environment, job="benchmarks.training_step:step_job", **job)
            name = f"{count:07} x{threads}"
            results[name] = {**job, **found}
            save_results(NAME, results, keep, [name])
    show = partial(replace_section, NAME, page=PAGE) if keep else print
    show(dated(step_table(results), NAME, keep))


if __name__ == "__main__":
    main()

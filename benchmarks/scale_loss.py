"""The loss of encoding in ranges: bytes against those of encoding in memory, at equal PSNR, scene by scene.

    python -m benchmarks.scale_loss                          the scenes of `SCENES` at effort 1: a quarter of an hour
    python -m benchmarks.scale_loss --scenes flowers --effort 1 2
    python -m benchmarks.scale_loss --short --no-write       the example scene, printed
    python -m benchmarks.scale_loss --report                 only rewrite the table

Every scene is cut into `RANGES` ranges, however small they are, and encoded at one quality; in memory at several, so
that bytes at the PSNR of the ranges can be read off between two of them. Lambda is the predicted one: correcting it
takes most of the time, and only moves a file along the line between others. PSNR is that of `benchmarks.judged`, from
views that no encoder knows. No file has a STREAMING block: one of ranges never has. Results are merged into
benchmarks/results/scale-loss.json; the table is in docs/large-scenes.md.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import child
from benchmarks.child import note_path
from benchmarks.encoded import encoded, kept_path
from benchmarks.quality import distortion
from benchmarks.report import SCRATCH, add_arguments, dated, load_results, replace_section, save_results, table
from benchmarks.scenes import FITTED_MARK, REPOSITORY, Scene, chosen

NAME = "scale-loss"
PAGE = REPOSITORY / "docs" / "large-scenes.md"
SCENES = ["plush-on-bed", "flowers", "biker", "plant"]
"""Measured unless scenes are named: the largest."""
SHORT_SCENES = ["plush-toys"]
QUALITY, IN_MEMORY = 45.0, (43.5, 46.0)
ALIKE = {"corrections": 0, "viewpoints": 0}
"""Options of all encoders."""
RANGES = 4
WANTED_LOSS = 0.02
"""Maximum loss that is wanted, as a share of the bytes."""

Figures = dict[str, Any]


def encode_job(job: Figures) -> Figures:
    """Job of `benchmarks.child`: encode a scene in ranges.

    Args:
        job: ``scene``, its name; ``quality``, ``effort``; ``ranges``, how many; ``out``, the file.

    Returns:
        ``bytes``, ``gaussians``, ``ranges``: there may be one less or more than was asked for.
    """
    from reference_encoder.scale.executor import workers
    from reference_encoder.scale.run import Job, encode_job
    from reference_encoder.scale.tasks import scene_of
    from reference_encoder.scale.work import Work
    from scarfmt.formats import load

    scene, out = chosen([job["scene"]])[0], Path(job["out"])
    folder = out.with_name(out.name + ".work")
    shutil.rmtree(folder, ignore_errors=True)
    size = math.ceil(len(load(scene.path)) / job["ranges"])
    work, options = Work(str(folder)), scene.options(quality=job["quality"], effort=job["effort"], **ALIKE)
    part = out.with_name(out.name + ".part")
    asked = Job(str(scene.path), work, options, "benchmark", range_size=size, drop_invalid=True)
    with workers(1, None) as alone, part.open("wb") as target:
        done = encode_job(asked, alone, target)
    found = {"bytes": done.file_bytes, "gaussians": done.count, "ranges": len(scene_of(work).ranges)}
    shutil.rmtree(folder)
    # The file last: where it is, it is whole and its note is there.
    note_path(out).write_text(json.dumps(found), encoding="utf-8")
    part.replace(out)
    return found


def in_ranges(scene: Scene, quality: float, effort: int) -> tuple[Path, Figures]:
    """The file of a scene in ranges, made unless it is there, and what :func:`encode_job` told."""
    path = kept_path(scene, f"q{quality:g}-e{effort}-ranges-{RANGES}")
    if not path.exists():
        job = {"scene": scene.name, "quality": quality, "effort": effort, "ranges": RANGES, "out": str(path)}
        child.run(job="benchmarks.scale_loss:encode_job", environment=child.ENVIRONMENT, **job)
    return path, json.loads(note_path(path).read_text(encoding="utf-8"))


def measure(scene: Scene, effort: int) -> Figures:
    """Bytes and PSNR of a scene, in ranges and in memory."""
    path, found = in_ranges(scene, QUALITY, effort)
    files = [Path(encoded(scene, quality, effort, **ALIKE)["path"]) for quality in IN_MEMORY]
    return {
        "scene": scene.name,
        "fitted": scene.fitted,
        "effort": effort,
        "gaussians": found["gaussians"],
        "ranges": found["ranges"],
        "in_ranges": _judged(scene, path),
        "in_memory": [_judged(scene, file) for file in files],
    }


def _judged(scene: Scene, path: Path) -> Figures:
    """Bytes of a file, and PSNR of its pictures, dB: the mean, and mean and least of each kind of view."""
    [last] = distortion(scene, path, whole=True)["layers"]
    return {"bytes": path.stat().st_size, "psnr_db": last["psnr_db"], "kinds": last["kinds"]}


def bytes_at(files: Sequence[Figures], psnr_db: float) -> float:
    """Bytes that a file of this PSNR would have: their logarithm, on the line between the files next to it.

    Raises:
        ValueError: no two files are above and below.
    """
    by_level = sorted(files, key=lambda file: float(file["psnr_db"]))
    levels = [file["psnr_db"] for file in by_level]
    if not levels[0] <= psnr_db <= levels[-1]:
        raise ValueError(f"{psnr_db} dB is not within {levels[0]} to {levels[-1]} dB: measure other qualities")
    return float(np.exp(np.interp(psnr_db, levels, np.log([file["bytes"] for file in by_level]))))


def loss(result: Figures) -> float:
    """Bytes in ranges beyond those in memory at the same PSNR, in the latter."""
    here = result["in_ranges"]
    return float(here["bytes"] / bytes_at(result["in_memory"], here["psnr_db"]) - 1)


def shown(results: Mapping[str, Figures]) -> str:
    """The table of the page, and mean and worst of every effort."""
    every = sorted(results.values(), key=lambda result: (result["effort"], -result["gaussians"]))
    rows = [
        [
            result["scene"] + (FITTED_MARK if result["fitted"] else ""),
            str(result["effort"]),
            f"{result['gaussians']:,}",
            str(result["ranges"]),
            f"{result['in_ranges']['psnr_db']:.2f}",
            f"{result['in_ranges']['bytes']:,}",
            f"{bytes_at(result['in_memory'], result['in_ranges']['psnr_db']):,.0f}",
            f"{100 * loss(result):+.1f} %",
        ]
        for result in every
    ]
    head = ["scene", "effort", "Gaussians", "ranges", "dB", "bytes", "in memory, same dB", "loss"]
    return table(head, rows) + "\n" + "\n".join(_summaries(every))


def _summaries(results: Sequence[Figures]) -> list[str]:
    lines = []
    for effort in sorted({result["effort"] for result in results}):
        losses = {result["scene"]: 100 * loss(result) for result in results if result["effort"] == effort}
        worst = max(losses, key=lambda scene: losses[scene])
        mean = f"Effort {effort}: {np.mean(list(losses.values())):+.1f} % on average of {len(losses)} scenes"
        lines.append(f"{mean}, {losses[worst]:+.1f} % at worst ({worst}); at most {100 * WANTED_LOSS:g} % is wanted.")
    return lines


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--effort", nargs="+", type=int, default=[1])
    parser.add_argument("--report", action="store_true", help="measure nothing, rewrite the table")
    arguments = parser.parse_args()
    SCRATCH.mkdir(parents=True, exist_ok=True)
    keep = not arguments.no_write
    results = load_results(NAME) if keep else {}
    names = arguments.scenes or (SHORT_SCENES if arguments.short else SCENES)
    for scene in [] if arguments.report else chosen(names):
        for effort in arguments.effort:
            key = f"{scene.name} e{effort}"
            print(key, file=sys.stderr, flush=True)
            results[key] = measure(scene, effort)
            save_results(NAME, results, keep, [key])
    show = partial(replace_section, NAME, page=PAGE) if keep else print
    show(dated(shown(results), NAME, keep))


if __name__ == "__main__":
    main()

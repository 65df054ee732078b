"""Time, memory and bytes read: encoding by effort, decoding, export, inspection.

    python -m benchmarks.speed                              flowers, the largest scene
    python -m benchmarks.speed --scenes plush-dog --quality 45 --efforts 1 2

Every figure comes from a process of its own. Encoding does not count importing the scene.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from typing import Any

from benchmarks import child
from benchmarks.quality import encoded_path
from benchmarks.report import load_results, machine, replace_section, save_results, table
from benchmarks.scenes import Scene, chosen
from scarfmt.cli.scenes import layer_table, load_subject
from scarfmt.render.compare import compare

NAME = "speed"
DEFAULT_SCENES = ("flowers",)


def measure(scene: Scene, quality: float, efforts: list[int]) -> dict[str, Any]:
    """All figures of one scene; decoding is that of the highest effort's file."""
    original = load_subject(str(scene.path)).remembering()
    encodes = []
    for effort in sorted(efforts):
        path = encoded_path(scene, quality, effort)
        print(f"{scene.name}, quality {quality:g}, effort {effort}", file=sys.stderr)
        job = child.run(job="encode", scene=scene.name, quality=quality, effort=effort, out=str(path))
        decoded = load_subject(str(path))
        psnr = compare(original.view, decoded.view, scene.judged_cameras(original), ssim=False).mean_psnr_db
        size = layer_table(str(path))[-1]["bytes_per_source"]
        encodes.append({**job, "effort": effort, "psnr_db": psnr, "bytes_per_source": size})
    file = str(path)
    return {
        "scene": scene.name,
        "count": len(original.placed),
        "quality": quality,
        "encode": encodes,
        "decode": [child.run(job="decode", file=file, threads=threads) for threads in (1, 2)],
        "first_layer": child.run(job="decode", file=file, threads=2, layers=1),
        "export": child.run(job="export", file=file, out=file + ".ply"),
        "inspect": child.run(job="inspect", file=file),
        "machine": machine(),
    }


def markdown(results: dict[str, Any]) -> str:
    """The tables of the page."""
    parts = []
    for run in results.values():
        parts.append(f"**{run['scene']}**, {run['count']:,} Gaussians or anchors, quality {run['quality']:g}")
        parts.append(table(["encode", "seconds", "peak MiB", "B/source", "PSNR dB"], _encode_rows(run)))
        parts.append(table(["read", "seconds", "peak MiB"], _read_rows(run)))
    machines = "; ".join(sorted({run["machine"] for run in results.values()}))
    return "\n\n".join([*parts, f"Measured on {machines}."])


def _encode_rows(run: dict[str, Any]) -> list[list[str]]:
    return [
        [f"effort {job['effort']}", *_cost(job, 1), f"{job['bytes_per_source']:.2f}", f"{job['psnr_db']:.2f}"]
        for job in run["encode"]
    ]


def _read_rows(run: dict[str, Any]) -> list[list[str]]:
    told = run["inspect"]
    return [
        ["decode to arrays, 1 thread", *_cost(run["decode"][0])],
        ["decode to arrays, 2 threads", *_cost(run["decode"][1])],
        ["first layer only, 2 threads", *_cost(run["first_layer"])],
        ["export to PLY, tile by tile", *_cost(run["export"])],
        [f"inspect ({told['bytes_read']:,} bytes in {told['reads']} reads)", *_cost(told, 4)],
    ]


def _cost(job: dict[str, Any], digits: int = 2) -> list[str]:
    return [f"{job['seconds']:.{digits}f}", f"{job['peak_bytes'] / 2**20:,.0f}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", metavar="NAME", default=DEFAULT_SCENES)
    parser.add_argument("--quality", type=float, default=45.0)
    parser.add_argument("--efforts", nargs="+", type=int, choices=(1, 2, 3), default=[1, 2, 3])
    parser.add_argument("--no-write", action="store_true", help="print the tables instead of keeping results")
    arguments = parser.parse_args()
    results = {} if arguments.no_write else load_results(NAME)
    for scene in chosen(arguments.scenes):
        results[scene.name] = measure(scene, arguments.quality, arguments.efforts)
        if not arguments.no_write:
            save_results(NAME, results)
    show = print if arguments.no_write else partial(replace_section, NAME)
    if results:
        show(markdown(results))


if __name__ == "__main__":
    main()

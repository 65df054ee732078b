"""The cost of decoding a box instead of a whole scene, by the size of tiles.

    python -m benchmarks.regions                            flowers and plush-on-bed: about twenty minutes
    python -m benchmarks.regions --short --no-write         the example scene, printed

A scene is encoded once, in the largest tiles; its integers are then written again in smaller ones, with the networks
that were trained for the largest. Boxes have 1 % and 10 % of a volume (`benchmarks.regions_jobs.boxes`). Bytes are all
that is read of a file: header, directory, models, and the blocks of the tiles that a box meets.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from statistics import fmean, median
from typing import Any

from benchmarks import child
from benchmarks.encoded import kept_path
from benchmarks.plots import line, new_plot, save_plot
from benchmarks.report import add_arguments, dated, load_results, replace_section, save_results, table
from benchmarks.scaling import PAGE
from benchmarks.scenes import Scene, chosen

NAME = "regions"
QUALITY = 41.0
TARGET = 0.05
"""Target share of the bytes and of the time, for 1 % of the volume."""
SCENES = ("flowers", "plush-on-bed")
TILES = (32768, 16384, 8192, 4096, 2048, 1024)
SHARES = (0.01, 0.1)
COUNTS = {0.01: 100, 0.1: 100}
TIMED = {0.01: 20, 0.1: 8}
"""Boxes of each share that are decoded: the first of those in `COUNTS`, whose bytes are counted."""
_JOBS = "benchmarks.regions_jobs"
_SCALING = "benchmarks.scaling_jobs"


def measure(scene: Scene, short: bool, keep: Callable[[str, dict[str, Any]], None]) -> None:
    """All sizes of tiles of one scene, static and neural; each is given to `keep` as soon as it is there."""
    effort = 1 if short else 2
    base = kept_path(scene, f"regions-q{QUALITY:g}-e{effort}-t{TILES[0]}")
    if not base.exists():
        print(f"{scene.name}: encode", file=sys.stderr)
        options: dict[str, Any] = {"quality": QUALITY, "effort": effort, "tile_anchors": TILES[0]}
        child.run(job=f"{_SCALING}:encode", scene=scene.name, out=str(base), **options)
    counts = list(COUNTS.items())
    regions = child.run(job=f"{_JOBS}:choose", file=str(base), counts=counts)["regions"]
    for coded in ("static",) if short else ("static", "neural"):
        for most in TILES[:1] + TILES[3:4] if short else TILES:
            print(f"{scene.name}: {coded}, tiles of {most}", file=sys.stderr)
            found = _of_file(scene, base, coded, most, regions, 4 if short else None)
            if found is None:
                print("too much work a byte for a reader's limits, as are smaller tiles", file=sys.stderr)
                break
            keep(f"{scene.name} {coded} {most:05d}", found)


def _of_file(
    scene: Scene, base: Path, coded: str, most: int, regions: list[dict[str, Any]], timed_most: int | None
) -> dict[str, Any] | None:
    """The measurements of one file; None if no decoder with the usual limits would accept it (SPEC §13.2)."""
    path = base.with_suffix(f".{coded}-{most}.scar")
    facts = child.run(
        job=f"{_SCALING}:rewrite", file=str(base), static=coded == "static", tile_anchors=most, out=str(path)
    )
    if not facts["within_limits"]:
        path.unlink()
        return None
    # The whole scene of outliers is for bytes alone: most of its boxes take nearly all.
    timed = [
        {**region, "boxes": region["boxes"][: timed_most or TIMED[region["share"]]]}
        for region in regions
        if region["place"] != "whole"
    ]
    sizes = child.run(job=f"{_JOBS}:sizes", file=str(path), regions=regions)
    times = child.run(child.ENVIRONMENT, job=f"{_JOBS}:times", file=str(path), regions=timed)
    found = []
    for region, size in zip(regions, sizes.pop("regions"), strict=True):
        lists = {"anchors": region["anchors"], **size}
        if region["place"] != "whole":
            lists |= times["regions"].pop(0)
        kind = {"place": region["place"], "share": region["share"]}
        found.append({**kind, **{field: spread(values) for field, values in lists.items()}})
    del times["regions"]
    path.unlink()
    return {
        "scene": scene.name,
        "coded": coded,
        "most": most,
        "anchors": facts["anchors"],
        **sizes,
        **times,
        "regions": found,
    }


def spread(values: Sequence[float]) -> dict[str, float]:
    """A summary of the figures of many boxes, to five digits."""
    found = {"median": median(values), "mean": fmean(values), "worst": max(values)}
    return {name: float(f"{value:.5g}") for name, value in found.items()}


def shares(run: dict[str, Any], place: str, share: float, field: str) -> dict[str, float]:
    """The spread, over boxes of a kind, of a share of the whole file's `field`: anchors, bytes, cpus or symbols."""
    region = next(r for r in run["regions"] if (r["place"], r["share"]) == (place, share))
    whole = {"anchors": 1.0, "bytes": run["file_bytes"], "cpus": run["cpu"], "symbols": run["symbols"]}
    return {name: value / whole[field] for name, value in region[field].items()}


def markdown(results: dict[str, Any]) -> str:
    """The tables of the page."""
    parts = []
    for scene in dict.fromkeys(run["scene"] for run in results.values()):
        for coded in ("static", "neural"):
            found = [run for run in results.values() if (run["scene"], run["coded"]) == (scene, coded)]
            runs = sorted(found, key=lambda run: -int(run["most"]))
            if runs:
                parts += [_title(runs[0]), _file_table(runs), _box_table(runs)]
    return "\n\n".join(parts)


def _title(run: dict[str, Any]) -> str:
    held = {share: shares(run, "anchor", share, "anchors")["median"] for share in SHARES}
    found = ", ".join(f"{share:.0%} of the volume holds {part:.1%} of the anchors" for share, part in held.items())
    models = f"Models take {run['model_bytes'] / run['file_bytes']:.1%} of the bytes."
    about = f"**{run['scene']}, {run['coded']}**, {run['anchors']:,} anchors."
    return f"{about} Round an anchor of the core, {found} (median). {models}"


def _file_table(runs: Sequence[dict[str, Any]]) -> str:
    head = ["anchors a tile", "tiles", "bytes", "more", "layer 1, more", "header and directory", "decode s", "more"]
    first = runs[0]
    rows = [
        [
            f"{run['most']:,}",
            str(run["tiles"]),
            f"{run['file_bytes']:,}",
            f"{run['file_bytes'] / first['file_bytes'] - 1:.1%}",
            f"{run['layer_bytes'][0] / first['layer_bytes'][0] - 1:.1%}",
            f"{run['front_bytes'] / run['file_bytes']:.1%}",
            f"{run['cpu']:.2f}",
            f"{run['cpu'] / first['cpu'] - 1:.0%}",
        ]
        for run in runs
    ]
    return table(head, rows)


_COLUMNS: tuple[tuple[str, str, float, str], ...] = (
    ("1 % round an anchor: bytes", "anchor", 0.01, "bytes"),
    ("time", "anchor", 0.01, "cpus"),
    ("symbols", "anchor", 0.01, "symbols"),
    ("1 % anywhere: bytes", "anywhere", 0.01, "bytes"),
    ("time", "anywhere", 0.01, "cpus"),
    ("10 % round an anchor: bytes", "anchor", 0.1, "bytes"),
    ("time", "anchor", 0.1, "cpus"),
    ("1 % of everything: bytes", "whole", 0.01, "bytes"),
)


def _box_table(runs: Sequence[dict[str, Any]]) -> str:
    rows = []
    for run in runs:
        cells = []
        for _, place, share, field in _COLUMNS:
            found = shares(run, place, share, field)
            middle = found["mean" if place == "anywhere" else "median"]
            cells.append(f"{_marked(middle, share)} / {found['worst']:.0%}")
        rows.append([f"{run['most']:,}", *cells])
    return table(["anchors a tile", *(column[0] for column in _COLUMNS)], rows)


def _marked(value: float, share: float) -> str:
    return f"**{value:.1%}**" if share == SHARES[0] and value <= TARGET else f"{value:.1%}"


def plot(results: dict[str, Any], keep: bool) -> None:
    """Bytes of a region against bytes of the file, a line per scene and coding."""
    figure, axes = new_plot("more bytes than with the largest tiles, %", "bytes of a region, % of the file")
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for run in results.values():
        groups.setdefault((run["scene"], run["coded"]), []).append(run)
    for number, ((scene, coded), runs) in enumerate(sorted(groups.items())):
        runs.sort(key=lambda run: -int(run["most"]))
        more = [100 * (run["file_bytes"] / runs[0]["file_bytes"] - 1) for run in runs]
        cost = [100 * shares(run, "anchor", SHARES[0], "bytes")["median"] for run in runs]
        line(axes, more, cost, f"{scene}, {coded}", number, coded == "static")
    axes.axhline(100 * TARGET, color="#999999", linewidth=0.8)
    save_plot(figure, "regions-tiles", keep)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--report", action="store_true", help="only draw tables and plots again from earlier results")
    arguments = parser.parse_args()
    write = not arguments.no_write
    results = load_results(NAME) if write or arguments.report else {}

    def keep(name: str, run: dict[str, Any]) -> None:
        results[name] = run
        save_results(NAME, results, write, [name])

    if not arguments.report:
        for scene in chosen(arguments.scenes or (("plush-toys",) if arguments.short else SCENES)):
            measure(scene, arguments.short, keep)
    plot(results, write)
    show = partial(replace_section, NAME, page=PAGE) if write else print
    show(dated(markdown(results), NAME, write))


if __name__ == "__main__":
    main()

"""Bytes to 30, 35 and 41 dB in view: files fetched in file order, in view first, as planned, and as planned by gains.

    python -m benchmarks.streaming                             plush-on-bed and flowers; half an hour on one core
    python -m benchmarks.streaming --short --no-write          the example scene, two views, printed
    python -m benchmarks.streaming --scenes flowers --views 1
    python -m benchmarks.streaming --report                    only rewrite docs/streaming.md

Views are along recorded motions of heads, put into our scenes (`benchmarks.streaming_motion`). How plans are made was
chosen by such views of plush-on-bed, and by none of flowers. Each view starts from nothing. dB are those of the view
against the same view of the whole file. Files are of the default options without networks, in tiles as by default and
in small ones, with and without what tells clients of gains, whose bytes count. Results are kept in
benchmarks/results/streaming.json.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks import provenance
from benchmarks.encoded import encoded
from benchmarks.report import SKIPPED, add_arguments, dated, load_document, replace_section, save_results, table
from benchmarks.scaling_scenes import read_scene, recut
from benchmarks.scenes import REPOSITORY, Scene, chosen
from benchmarks.streaming_motion import motions, starts, views
from benchmarks.streaming_orders import ORDERS, Fetching, Film, bytes_to, curve, planned_for
from reference_encoder.options import EncodeOptions
from reference_encoder.streaming.told import told, usual_viewpoints
from scarfmt.blocks.streaming import pack_streaming
from scarfmt.coding.writer import write_scene
from scarfmt.engines import best_engine
from scarfmt.formats import load
from scarfmt.render.capture import load_cameras
from scarfmt.render.viewpoints import Surroundings
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.tools.annotate import with_streaming

NAME = "streaming"
PAGE = REPOSITORY / "docs" / "streaming.md"
DECIBELS = (30.0, 35.0, 41.0)
QUALITIES = {"plush-on-bed": 44.0, "plush-on-bed, poses": 44.0, "flowers": 41.0, "plush-toys": 42.0}
SCENES = ("plush-on-bed", "plush-on-bed, poses", "flowers")
MOST_TILE, SMALL_TILE, SHORT_TILE = 65536, 8192, 2048
MARKS = np.concatenate([np.linspace(0.03, 0.5, 16), np.linspace(0.55, 1.02, 10)])
"""Parts of a file after which a view is looked at."""
Record = dict[str, Any]


def measure(scene: Scene, most: int, count: int, effort: int, recordings: int) -> Record:
    """All orders of a scene in tiles of at most `most`, from `count` views of each of some recordings."""
    options = scene.options()
    path = encoded(scene, QUALITIES[scene.name], effort, decode_budget=0, viewpoints=0)["path"]
    quantised = recut(read_scene(path), most)
    data = write_scene(quantised, engine=best_engine())
    streaming = told(quantised, EncodeOptions(cameras=options.cameras), usual_viewpoints(quantised, len(data)))
    fetching, film = Fetching(with_streaming(data, streaming)), Film(quantised)
    marks = MARKS * len(data)
    found: dict[str, list[list[float]]] = {name: [] for name in ORDERS}
    for view in views_of(scene, count, recordings):
        for name, (order, needs) in ORDERS.items():
            steps = order(fetching.index, streaming if needs else None, planned_for(view))
            found[name].append(curve(film, view, steps, fetching.sizes(steps, needs), marks))
    return {
        "bytes": len(data),
        "told": len(pack_streaming(streaming)),
        "viewpoints": len(streaming.viewpoints),
        "tiles": len(quantised.tiles),
        "views": len(found["file order"]),
        "to": {name: [_mean_bytes(db, marks, curves) for db in DECIBELS] for name, curves in found.items()},
        "db": {name: np.minimum(curves, 60).mean(axis=0).round(2).tolist() for name, curves in found.items()},
    }


def _mean_bytes(decibels: float, marks: Any, curves: Sequence[Sequence[float]]) -> int:
    return int(np.mean([bytes_to(decibels, marks, curve) for curve in curves]))


def views_of(scene: Scene, count: int, recordings: int) -> list[Any]:
    source = load(scene.path)
    assert isinstance(source, GaussianScene)
    around = Surroundings.of(source, scene.up)
    cameras = [] if scene.captured is None else load_cameras(scene.captured)
    taken = motions()[:recordings]
    begun = starts(around, [camera for camera in cameras if camera.split != "train"], len(taken))
    return [view for motion, start in zip(taken, begun, strict=True) for view in views(motion, start, around, count)]


def tables(results: dict[str, Record]) -> str:
    """A row a file and order: bytes to each quality, and how many fewer than in file order."""
    head = ["file", "order", *(f"kB to {db:g} dB" for db in DECIBELS), *(f"{db:g} dB" for db in DECIBELS)]
    rows = []
    for name, record in results.items():
        base = record["to"]["file order"]
        for order, sizes in record["to"].items():
            share = [f"{100 * (size / first - 1):+.0f} %" for size, first in zip(sizes, base, strict=True)]
            cells = ["–"] * len(base) if order == "file order" else share
            rows.append([name, order, *(f"{size / 1000:,.0f}" for size in sizes), *cells])
    about = ["file", "kB", "tiles", "viewpoints", "told, bytes", "of the file", "views"]
    files = [
        [name, f"{r['bytes'] / 1000:,.0f}", str(r["tiles"]), str(r["viewpoints"]), f"{r['told']:,}",
         f"{100 * r['told'] / r['bytes']:.2f} %", str(r["views"])]
        for name, r in results.items()
    ]  # fmt: skip
    return table(head, rows, 2) + "\n" + table(about, files)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--views", type=int, default=2, metavar="N", help="views of each recording [default: 2]")
    parser.add_argument("--effort", type=int, default=2, help="effort of encoding [default: 2]")
    parser.add_argument("--report", action="store_true", help="only rewrite docs/streaming.md")
    said = parser.parse_args(arguments)
    keep = not said.no_write
    results = provenance.figures(load_document(NAME, keep))
    if not said.report:
        if not motions():
            print("no recordings of heads: see SCAR_DATA in benchmarks/scenes.py", file=sys.stderr)
            return SKIPPED
        names = said.scenes or (["plush-toys"] if said.short else list(SCENES))
        count, effort, recordings = (1, 1, 2) if said.short else (said.views, said.effort, 6)
        small = SHORT_TILE if said.short else SMALL_TILE
        measured = []
        for scene in chosen(names):
            for most, what in ((MOST_TILE, "tiles as by default"), (small, f"tiles of {small:,}")):
                key = f"{scene.name}, {what}"
                results[key] = measure(scene, most, count, effort, recordings)
                measured.append(key)
                save_results(NAME, results, keep, measured)
    text = tables(results)
    print(text)
    if keep:
        replace_section(NAME, dated(text, NAME), PAGE)
    return 0


if __name__ == "__main__":
    sys.exit(main())

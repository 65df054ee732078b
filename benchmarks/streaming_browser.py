"""The viewer page in a real browser over a slow network: when the picture is there, what it costs, and by bytes alone.

    python -m benchmarks.streaming_browser                       plush-on-bed, flowers; some minutes
    python -m benchmarks.streaming_browser --short --no-write    the example scene, once, printed
    python -m benchmarks.streaming_browser --report              only rewrite docs/viewing.md

Chromium without a window or a GPU opens the page that `make web` built, as `scarfmt view` serves it, through a network
of 10 Mbit/s that all connections share, with a round trip of 50 ms (web/test/shaped.ts). The page notes when which
layer of which tile is on the GPU; what that looks like is drawn afterwards by our renderer, for the view that the file
begins with, and compared with the whole file. WebGL draws nothing meanwhile: in software that takes the processors from
everything else. Results are kept in benchmarks/results/streaming-browser.json.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks import provenance
from benchmarks.encoded import encoded
from benchmarks.report import SKIPPED, add_arguments, dated, load_document, replace_section, save_results
from benchmarks.scaling_scenes import read_scene
from benchmarks.scenes import REPOSITORY, Scene, chosen
from benchmarks.streaming_browser_figures import Figures, Log, Picture, by_bytes, figures, simulated
from benchmarks.streaming_browser_tables import tables
from scarfmt.container.source import FileSource
from scarfmt.viewer.offered import PAGE, page_offers, scene_offer
from scarfmt.viewer.server import ViewerServer

NAME = "streaming-browser"
DOCUMENT = REPOSITORY / "docs" / "viewing.md"
WEB = REPOSITORY / "web"
DRIVER = WEB / "dist" / "tests" / "measure.mjs"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
MBIT, ROUND_TRIP_MS = 10.0, 50.0
SIZE = (640, 480)
"""Size of the page, pixels; pictures are compared at half of it."""
PATIENCE_S = 240
TILE = 8192
QUALITIES = {"plush-on-bed, poses": 41.0, "flowers": 41.0, "plush-toys": 42.0}
TIMED, BOUNDED = "plush-on-bed, poses", "flowers"
CONDITIONS: dict[str, dict[str, Any]] = {
    "page open": {"open": True, "draws": False},
    "page not there yet": {"open": False, "draws": False},
}
BUDGETS_MB = (24, 48)
Record = dict[str, Any]


def lacking() -> str | None:
    """The requirements that this machine lacks, None if nothing."""
    if shutil.which("node") is None or not DRIVER.exists() or not PAGE.joinpath("index.html").is_file():
        return "node, or what `make web` builds, is missing"
    return None if _browser() else "there is no Chromium on the path"


def _browser() -> str | None:
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)


@contextmanager
def serving(path: Path) -> Iterator[tuple[int, str]]:
    """A server of the page and a scene: its port, and the scene's path there."""
    where, offer = scene_offer(str(path), 0, FileSource(path))
    with ViewerServer({**page_offers(), where: offer}) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield server.server_address[1], where
        finally:
            server.shutdown()
            thread.join()


def measured(path: Path, query: str = "", **condition: Any) -> Log:
    """One run of the browser."""
    width, height = SIZE
    with serving(path) as (port, scene):
        wish = {"port": port, "scene": scene, "query": query, "mbitPerSecond": MBIT, "roundTripMs": ROUND_TRIP_MS}
        wish |= {"width": width, "height": height, "patienceMs": 1000 * PATIENCE_S, **condition}
        command = ["node", str(DRIVER), json.dumps(wish)]
        environment = {**os.environ, "CHROMIUM": _browser() or ""}
        done = subprocess.run(command, cwd=WEB, env=environment, capture_output=True, text=True, timeout=2 * PATIENCE_S)
    if done.returncode != 0:
        raise RuntimeError(done.stderr[-2000:])
    return Log.of(json.loads(done.stdout))


def timed(scene: Scene, runs: int) -> dict[str, Record]:
    """Every condition, what bytes alone would take, and what the simulation says; medians and least of all runs."""
    path = _file(scene)
    picture = Picture(path.read_bytes(), read_scene(path), SIZE)
    found: dict[str, Record] = {}
    found["by bytes alone"] = {"runs": 1, "median": by_bytes(picture, MBIT, ROUND_TRIP_MS)}
    found["simulated"] = {"runs": 1, "median": simulated(picture, MBIT, ROUND_TRIP_MS)}
    for name, condition in CONDITIONS.items():
        each = [figures(measured(path, **condition), picture) for _ in range(runs)]
        found[name] = {"runs": runs, "median": _over(each, median), "least": _over(each, min)}
        print(f"{scene.name}, {name}: {found[name]}", file=sys.stderr)
    about = {"bytes": path.stat().st_size, "tiles": picture.tiles, "layers": picture.layers, "splats": picture.splats}
    return {f"{scene.name}, {name}": {**about, **record} for name, record in found.items()}


def bounded(scene: Scene) -> dict[str, Record]:
    """The most memory that the page says it uses, without a bound that matters and with some."""
    path = _file(scene)
    found: dict[str, Record] = {}
    for budget in (None, *BUDGETS_MB):
        log = measured(path, "" if budget is None else f"memory={budget}", **CONDITIONS["page open"])
        told = {"budget": budget, "most": log.most_memory / 1e6, "splats": log.splats, "evictions": log.evictions}
        found[f"{scene.name}, memory {budget or 'as by default'}"] = {"bytes": path.stat().st_size, **told}
    return found


def _file(scene: Scene) -> Path:
    return Path(encoded(scene, QUALITIES[scene.name], 1, tile_anchors=TILE)["path"])


def _over(each: Sequence[Figures], how: Callable[[Iterable[float]], float]) -> Figures:
    """By name, of the runs that have a figure."""
    values = {name: [value for one in each if (value := one[name]) is not None] for name in each[0]}
    return {name: how(found) if found else None for name, found in values.items()}


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser, scenes=False)
    parser.add_argument("--runs", type=int, default=5, help="runs of each condition [default: 5]")
    parser.add_argument("--report", action="store_true", help="only rewrite docs/viewing.md")
    said = parser.parse_args(arguments)
    keep = not said.no_write
    results = provenance.figures(load_document(NAME, keep))
    if not said.report:
        if (reason := lacking()) is not None:
            print(f"nothing can be measured: {reason}", file=sys.stderr)
            return SKIPPED
        runs = 1 if said.short else said.runs
        parts: tuple[tuple[str, Callable[[Scene], dict[str, Record]]], ...]
        parts = ((TIMED, lambda scene: timed(scene, runs)), (BOUNDED, bounded))
        for name, measure in parts:
            for scene in chosen(["plush-toys"] if said.short else [name]):
                found = measure(scene)
                results = {**results, **found}
                save_results(NAME, results, keep, list(found))
    text = tables(results)
    print(text)
    if keep:
        replace_section(NAME, dated(text, NAME), DOCUMENT)
    return 0


if __name__ == "__main__":
    sys.exit(main())

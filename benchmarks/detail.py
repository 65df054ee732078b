"""The picture of a view with some of a scene's Gaussians: chosen for the view, or by layers alone.

    python -m benchmarks.detail                              plush-on-bed and flowers; ten minutes on one core
    python -m benchmarks.detail --short --no-write           the example scene, two views, printed
    python -m benchmarks.detail --report                     only rewrite docs/scene-index.md

Views are along recorded motions of heads, put into our scenes (`benchmarks.streaming_motion`). A budget is a part of
all Gaussians of the file. "Layers alone" takes whole layers, and of the next one tiles in file order; "layers, in the
picture" does that with the tiles that meet the picture. dB are those of the view against the same view of the source.
Results are kept in benchmarks/results/detail.json.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from benchmarks import provenance
from benchmarks.encoded import encoded
from benchmarks.report import SKIPPED, add_arguments, dated, load_document, replace_section, save_results, table
from benchmarks.scenes import REPOSITORY, Scene, chosen
from benchmarks.streaming import QUALITIES, views_of
from benchmarks.streaming_motion import motions
from benchmarks.streaming_orders import drawn, planned_for
from reference_decoder.request import DecodeRequest
from reference_decoder.scenes.needs import LevelOfDetail, Need
from reference_decoder.scenes.scene_set import SceneSet, open_scene
from scarfmt.blocks.streaming import Streaming, read_streaming
from scarfmt.container.file import Container
from scarfmt.formats import load
from scarfmt.render import camera as drawing
from scarfmt.render.metrics import psnr
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.streaming.boxes import tight_boxes
from scarfmt.streaming.levels import Parts, meets_picture, parts_of
from scarfmt.streaming.levels import chosen as taken_of
from scarfmt.streaming.plan import SceneIndex
from scarfmt.streaming.view import Camera

NAME = "detail"
PAGE = REPOSITORY / "docs" / "scene-index.md"
SCENES = ("plush-on-bed", "flowers")
PARTS = (0.1, 0.25, 0.5, 1.0)
TOLD, UNTOLD, SEEN, LAYERS = "by the view, told", "by the view, nothing told", "layers, in the picture", "layers alone"
Record = dict[str, Any]


class Subject:
    """A file of one scene, and its tiles after any layers."""

    def __init__(self, scene: SceneSet) -> None:
        self.scene = scene
        with scene.files.opened(0) as source:
            container = Container.open(source).load()
            self.index, self.told = SceneIndex.of(container), read_streaming(container)

    @property
    def total(self) -> int:
        """Gaussians of the file."""
        return self.scene.layers[-1].gaussians

    def by_view(self, camera: Camera, budget: int, told: Streaming | None) -> list[Need]:
        """The parts that `decode --budget` takes, with or without the gains in the file."""
        if told is not None:
            return self.scene.needs(LevelOfDetail(camera, budget), DecodeRequest())
        tiles, layers = self.index.bytes.shape
        parts = parts_of(0, self.index, None, camera, layers=layers, tiles=np.arange(tiles), outside=False)
        ordered = Parts.joined([parts])
        found = taken_of(ordered, ordered.within(budget))
        return [Need(*row) for row in zip(*(column.tolist() for column in found), strict=True)]

    def by_layers(self, tiles: Iterable[int], budget: int) -> list[Need]:
        """Whole layers of some tiles, and of the next layer as many tiles as fit, in file order."""
        have, left = dict.fromkeys(tiles, 0), budget
        for layer in range(1, self.index.counts.shape[1] + 1):
            for tile in have:
                new = int(self.index.counts[tile, layer - 1])
                if new > left:
                    return self._needs(have)
                have[tile], left = layer, left - new
        return self._needs(have)

    def _needs(self, have: dict[int, int]) -> list[Need]:
        return [Need(0, tile, k, int(self.index.counts[tile, :k].sum())) for tile, k in have.items() if k]

    def picture(self, needs: list[Need], view: drawing.Camera) -> Any:
        """The picture of some tiles in a view."""
        parts = self.scene.made_of(needs, lambda part, _: part.scene, DecodeRequest())
        return drawn([part for part in parts if isinstance(part, GaussianScene)], view)


def measure(scene: Scene, count: int, effort: int, recordings: int) -> Record:
    """Mean dB of all views, by how Gaussians are chosen, at each budget."""
    path = encoded(scene, QUALITIES[scene.name], effort)["path"]
    source = load(scene.path)
    assert isinstance(source, GaussianScene)
    with open_scene(path) as opened:
        subject = Subject(opened)
        boxes = tight_boxes(subject.index.cubes, subject.told)
        rows: dict[str, list[list[float]]] = {name: [] for name in (TOLD, UNTOLD, SEEN, LAYERS)}
        numbers: dict[str, list[list[int]]] = {name: [] for name in rows}
        for view in views_of(scene, count, recordings):
            camera, wanted = planned_for(view), drawn([source], view)
            seen = np.flatnonzero(meets_picture(boxes, camera)).tolist()
            found: dict[str, list[list[Need]]] = {name: [] for name in rows}
            for budget in (int(part * subject.total) for part in PARTS):
                found[TOLD].append(subject.by_view(camera, budget, subject.told))
                found[UNTOLD].append(subject.by_view(camera, budget, None))
                found[SEEN].append(subject.by_layers(seen, budget))
                found[LAYERS].append(subject.by_layers(range(len(subject.index.bytes)), budget))
            for name, choices in found.items():
                rows[name].append([psnr(subject.picture(needs, view), wanted) for needs in choices])
                numbers[name].append([sum(need.gaussians for need in needs) for needs in choices])
        return {
            "gaussians": subject.total,
            "tiles": len(subject.index.bytes),
            "layers": [layer.gaussians for layer in opened.layers],
            "views": len(rows[TOLD]),
            "db": {name: np.mean(values, axis=0).round(2).tolist() for name, values in rows.items()},
            "taken": {name: np.mean(values, axis=0).round().tolist() for name, values in numbers.items()},
        }


def tables(results: dict[str, Record]) -> str:
    """A row a file and way of choosing."""
    head = ["file", "chosen", *(f"{100 * part:g} %: {what}" for what in ("dB", "taken") for part in PARTS)]
    rows = [
        [name, how, *(f"{value:.2f}" for value in decibels), *(f"{value:,.0f}" for value in record["taken"][how])]
        for name, record in results.items()
        for how, decibels in record["db"].items()
    ]
    about = ["file", "Gaussians", "after each layer", "tiles", "views"]
    files = [
        [name, f"{r['gaussians']:,}", " / ".join(f"{n:,}" for n in r["layers"]), str(r["tiles"]), str(r["views"])]
        for name, r in results.items()
    ]
    return table(head, rows, 2) + "\n" + table(about, files)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--views", type=int, default=1, metavar="N", help="views of each recording [default: 1]")
    parser.add_argument("--effort", type=int, default=1, help="effort of encoding [default: 1]")
    parser.add_argument("--report", action="store_true", help="only rewrite docs/scene-index.md")
    said = parser.parse_args(arguments)
    keep = not said.no_write
    results = provenance.figures(load_document(NAME, keep))
    if not said.report:
        if not motions():
            print("no recordings of heads: see SCAR_DATA in benchmarks/scenes.py", file=sys.stderr)
            return SKIPPED
        names = said.scenes or (["plush-toys"] if said.short else list(SCENES))
        count, recordings = (1, 2) if said.short else (said.views, 6)
        measured = []
        for scene in chosen(names):
            results[scene.name] = measure(scene, count, said.effort, recordings)
            measured.append(scene.name)
            save_results(NAME, results, keep, measured)
    text = tables(results)
    print(text)
    if keep:
        replace_section(NAME, dated(text, NAME), PAGE)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""The picture in view over time: files streamed over recorded networks while a recorded head moves, against rivals.

    python -m benchmarks.streaming_time                        four scenes; more than an hour on one core
    python -m benchmarks.streaming_time --short --no-write     the example scene, one condition, printed
    python -m benchmarks.streaming_time --scenes flowers
    python -m benchmarks.streaming_time --report               only rewrite docs/streaming.md

A condition is a network (`benchmarks.streaming_network`: recorded bandwidth, a round trip) and a motion
(`benchmarks.streaming_motion`). In each, clients fetch from a click at 0 s on (`benchmarks.streaming_clients`,
`.streaming_levels`), and the view of the moment is compared with that of the scene before compression, at moments a
quarter apart. Decoding and drawing take no time, for nobody. Pictures that were compared once are kept in
build/benchmarks/, so that a run that was cut goes on. Results are kept in benchmarks/results/streaming-time.json.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import provenance
from benchmarks.encoded import DRAWING, encoded, file_key, kept_path, source_key
from benchmarks.report import SKIPPED, add_arguments, load_document, save_results
from benchmarks.rivals_tools import install
from benchmarks.scaling_scenes import read_scene
from benchmarks.scenes import Scene, chosen
from benchmarks.streaming_clients import Client, ScarFile, ScarStream, WholeFile, run
from benchmarks.streaming_levels import NOTHING, LevelStream
from benchmarks.streaming_motion import Motion, motions, starts, view_at
from benchmarks.streaming_network import Link, Trace, traces
from benchmarks.streaming_orders import Film, drawn, planned_for
from benchmarks.streaming_policies import Oracle, Order, file_order, in_view_first, nearest_first, planned
from benchmarks.streaming_rivals import Levels, Whole, levels, wholes
from benchmarks.streaming_time_tables import BASE, NAME, ORACLE, OURS, tables, write_page
from benchmarks.streaming_times import HORIZON_S, MOMENTS, WATCHED_S, figures_of
from reference_encoder.streaming.told import streamed
from scarfmt.arrays import F64
from scarfmt.cli.scenes import load_subject
from scarfmt.render import camera as drawing
from scarfmt.render.capture import load_cameras
from scarfmt.render.metrics import psnr
from scarfmt.render.viewpoints import Surroundings
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.streaming.boxes import tight_boxes
from scarfmt.streaming.view import Camera, share_in_picture

QUALITIES = {"plush-on-bed, poses": 48.0, "flowers": 43.0, "biker": 45.0, "plush-dog": 45.0, "plush-toys": 42.0}
SCENES = ("plush-on-bed, poses", "flowers", "biker", "plush-dog")
EFFORT = 2
RECORDINGS = ("room-user101", "truck-user101")
BEGUN = 0.25
"""Part of a recording after which the click is."""
ROUND_TRIPS_S = (0.02, 0.1)
POLICIES: dict[str, tuple[Order, bool]] = {
    BASE: (file_order, False),
    "in view first": (in_view_first, False),
    "nearest first": (nearest_first, False),
    "planned, nothing told": (planned, False),
    OURS: (planned, True),
}
"""By name: the policy, and whether it wants the STREAMING block."""
STREAMED = "streamed SOG"
_ORACLE_S = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
_LOOKS_S = 0.5
MOST_DB = 100.0
Record = dict[str, Any]


@dataclass(frozen=True)
class Walk:
    """A motion in a scene, from the click on."""

    motion: Motion
    start: F64
    around: Surroundings

    def at(self, seconds: float) -> drawing.Camera:
        """The view of a moment."""
        return view_at(self.motion, self.start, self.around, BEGUN * float(self.motion.seconds[-1]) + seconds)

    def planned(self, seconds: float) -> Camera:
        """The view of a moment in the form that planners use."""
        return planned_for(self.at(seconds))


class Pictures:
    """How good pictures are, and remembers it.

    Args:
        original: what they are compared with.
        path: where that is kept.
    """

    def __init__(self, original: GaussianScene, path: Path) -> None:
        self._original, self._path = original, path
        self._known: dict[str, float] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        self._wanted: dict[tuple[str, int], F64] = {}

    def decibels(self, walk: Walk, moment: int, what: str, draw: Callable[[drawing.Camera], F64]) -> float:
        """The PSNR of what `draw` makes of the view at a moment; `what` names what is drawn."""
        key = f"{walk.motion.name} {moment} {what}"
        if key not in self._known:
            view = walk.at(float(MOMENTS[moment]))
            wanted = self._wanted.get((walk.motion.name, moment))
            if wanted is None:
                wanted = drawn([self._original], view)
                self._wanted[walk.motion.name, moment] = wanted
            self._known[key] = round(min(psnr(draw(view), wanted), MOST_DB), 3)
        return self._known[key]

    def keep(self) -> None:
        """Write down what is known."""
        self._path.write_text(json.dumps(self._known), encoding="utf-8")


class Parties:
    """All that streams a scene.

    Args:
        scene: which.
        original: before compression.
        rivals: whether there are any.
    """

    def __init__(self, scene: Scene, original: GaussianScene, rivals: bool) -> None:
        self._original = original
        path = Path(encoded(scene, QUALITIES[scene.name], EFFORT, decode_budget=0)["path"])
        self.key, self.scene = file_key(path)[:8], read_scene(path)
        # What clients are told is made anew: it does not decide what tiles hold.
        self.file = ScarFile(streamed(path.read_bytes(), self.scene, scene.options()))
        self._film, self._oracles = Film(self.scene), dict[str, Oracle]()
        self.wholes: dict[str, Whole] = {one.name: one for one in wholes(scene, original)} if rivals else {}
        self.levels: Levels | None = levels(scene, original) if rivals else None

    def names(self) -> list[str]:
        """Policies, then rivals."""
        return [*POLICIES, ORACLE, *([STREAMED] if self.levels else ()), *self.wholes]

    def client(self, name: str, walk: Walk) -> Client:
        """A new one."""
        if name in POLICIES:
            return ScarStream(self.file, *POLICIES[name])
        if name == ORACLE:
            return ScarStream(self.file, self._oracle(walk), False)
        if name == STREAMED:
            assert self.levels is not None
            return LevelStream(self.levels)
        return WholeFile(self.wholes[name].size)

    def _oracle(self, walk: Walk) -> Oracle:
        if walk.motion.name not in self._oracles:
            views = [(seconds, walk.at(seconds)) for seconds in _ORACLE_S]
            self._oracles[walk.motion.name] = Oracle(self.scene, self.file.index, views)
        return self._oracles[walk.motion.name]

    def picture(self, name: str, state: Any, view: drawing.Camera) -> F64:
        """The picture of the view."""
        if name == STREAMED:
            assert self.levels is not None
            return drawn([] if state == NOTHING else [self.levels.scenes[state]], view)
        if name in self.wholes:
            return drawn([self.wholes[name].scene] if state else [], view)
        return self._film.picture(state, view)

    def label(self, name: str, state: Hashable) -> str:
        """The label of what is drawn, equal for all policies of a file."""
        if name == STREAMED:
            return "black" if state == NOTHING else f"level {state} of streamed SOG"
        if name in self.wholes:
            return name if state else "black"
        assert isinstance(state, tuple)
        return f"{self.key} {' '.join(map(str, state))}" if any(state) else "black"

    def unseen(self, name: str, walk: Walk) -> Mapping[Hashable, float]:
        """Share of the arriving bytes that no view of the first seconds has in its picture: by tile, or at None."""
        views = [walk.planned(float(seconds)) for seconds in np.arange(0, WATCHED_S, _LOOKS_S)]
        if name in self.wholes:
            return {None: 1 - _share_of_centres(self.wholes[name].scene, walk)}
        if name == STREAMED:
            assert self.levels is not None
            return {None: 1 - _share_of_centres(self.levels.scenes[-1], walk)}
        boxes = tight_boxes(self.file.index.cubes, self.file.streaming)
        hidden = np.all([share_in_picture(boxes, view, 1.0) == 0 for view in views], axis=0)
        return {tile: float(unseen) for tile, unseen in enumerate(hidden.tolist())}


def _share_of_centres(scene: GaussianScene, walk: Walk) -> float:
    """Part of Gaussians whose centres are in some picture of the first seconds."""
    seen = np.zeros(len(scene), bool)
    for seconds in np.arange(0, WATCHED_S, _LOOKS_S):
        view = walk.at(float(seconds))
        x, y, z = (scene.positions @ view.world_to_camera[:3, :3].T + view.world_to_camera[:3, 3]).T
        seen |= (z > 0) & (np.abs(x) * view.fx * 2 <= z * view.width) & (np.abs(y) * view.fy * 2 <= z * view.height)
    return float(seen.mean())


def measure(scene: Scene, conditions: Sequence[tuple[Trace, float]], recordings: Sequence[str], rivals: bool) -> Record:
    """All parties in all conditions of one scene."""
    original = load_subject(str(scene.path)).placed
    assert isinstance(original, GaussianScene)
    parties, walks = Parties(scene, original, rivals), _walks(scene, original, recordings)
    drawing_key = source_key(DRAWING)[:8]
    pictures = Pictures(original, kept_path(scene, f"streaming-time-{parties.key}-{drawing_key}", ".json"))
    runs: dict[str, dict[str, Any]] = {}
    for walk in walks:
        unseen = {name: parties.unseen(name, walk) for name in parties.names()}
        for trace, round_trip in conditions:
            condition = f"{trace.name}, {1000 * round_trip:.0f} ms, {walk.motion.name}"
            print(f"{scene.name}: {condition}", file=sys.stderr, flush=True)
            runs[condition] = {
                name: _figures(parties, name, walk, Link(trace, round_trip), pictures, unseen[name])
                for name in parties.names()
            }
            pictures.keep()
    sizes = {name: whole.size for name, whole in parties.wholes.items()}
    sizes |= {} if parties.levels is None else {STREAMED: parties.levels.size}
    return {
        "gaussians": len(original),
        "tiles": len(parties.scene.tiles),
        "sizes": {"`.scar`": parties.file.size, **sizes},
        "networks": {trace.name: round(trace.mean, 2) for trace, _ in conditions},
        "curves": {trace.name: _mean_curves(runs, trace.name, parties.names()) for trace, _ in conditions},
        "runs": {
            condition: {name: {key: found[key] for key in found if key != "db"} for name, found in row.items()}
            for condition, row in runs.items()
        },
    }


def _figures(
    parties: Parties, name: str, walk: Walk, link: Link, pictures: Pictures, unseen: Mapping[Hashable, float]
) -> dict[str, Any]:
    """The figures of one party in one condition."""
    client = parties.client(name, walk)
    run(client, link, walk.planned, HORIZON_S)

    def decibels(moment: int, state: Hashable) -> float:
        what = parties.label(name, state)
        return pictures.decibels(walk, moment, what, lambda view: parties.picture(name, state, view))

    return figures_of(client, decibels, unseen)


def _mean_curves(runs: dict[str, dict[str, Any]], network: str, names: Sequence[str]) -> dict[str, list[float]]:
    """dB at each moment watched, mean over round trips and motions on one network."""
    rows = [row for condition, row in runs.items() if condition.startswith(f"{network}, ")]
    return {name: np.mean([row[name]["db"] for row in rows], axis=0).round(1).tolist() for name in names}


def _walks(scene: Scene, original: GaussianScene, recordings: Sequence[str]) -> list[Walk]:
    around = Surroundings.of(original, scene.up)
    cameras = [] if scene.captured is None else load_cameras(scene.captured)
    held_out = [camera for camera in cameras if camera.split != "train"]
    taken = [motion for motion in motions() if motion.name in recordings]
    begun = starts(around, held_out, len(taken))
    return [Walk(motion, start, around) for motion, start in zip(taken, begun, strict=True)]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--report", action="store_true", help="only rewrite docs/streaming.md")
    said = parser.parse_args(arguments)
    keep = not said.no_write
    results = provenance.figures(load_document(NAME, keep))
    if not said.report:
        found = traces()
        if not found:
            print("no recordings of networks: see SCAR_DATA in benchmarks/scenes.py", file=sys.stderr)
            return SKIPPED
        missing = None if said.short else install()
        if missing:
            print(f"no rivals: {missing}", file=sys.stderr)
        names = said.scenes or (["plush-toys"] if said.short else list(SCENES))
        conditions = [(trace, trip) for trace in found for trip in ROUND_TRIPS_S][: 1 if said.short else None]
        for scene in chosen(names):
            rivals = not said.short and missing is None
            results[scene.name] = measure(scene, conditions, RECORDINGS[: 1 if said.short else None], rivals)
            save_results(NAME, results, keep, [scene.name])
    results = {name: results[name] for name in (*SCENES, *results) if name in results}
    print(tables(results))
    if keep:
        write_page(results)
    return 0


if __name__ == "__main__":
    sys.exit(main())

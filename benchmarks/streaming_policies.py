"""The policies of a client that streams a file: its decision at any moment of a motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.streaming_orders import planned_for
from reference_encoder.options import EncodeOptions
from reference_encoder.streaming.told import told
from scarfmt.arrays import F64
from scarfmt.blocks.streaming import Streaming
from scarfmt.coding.writer import QuantisedScene
from scarfmt.render import camera as drawing
from scarfmt.streaming.boxes import Boxes, tight_boxes
from scarfmt.streaming.gains import told_gains
from scarfmt.streaming.plan import BEHIND, SceneIndex, Step, plan
from scarfmt.streaming.view import Camera, share_in_picture

Order = Callable[["Moment"], list[Step]]


@dataclass(frozen=True)
class Moment:
    """The values that are known when a plan is made.

    Attributes:
        index: of the file.
        streaming: what has come of what the file tells, or None.
        camera: now, with its velocity.
        seconds: since the click.
        have: (T,) layers that each tile has.
    """

    index: SceneIndex
    streaming: Streaming | None
    camera: Camera
    seconds: float
    have: Sequence[int]


def file_order(moment: Moment) -> list[Step]:
    """Layer by layer, tiles in Morton order."""
    return plan(moment.index, None, None, moment.have)


def in_view_first(moment: Moment) -> list[Step]:
    """The planned order, with the tiles outside the picture after all others."""
    seen = share_in_picture(tight_boxes(moment.index.cubes, None), moment.camera) > 0
    return sorted(file_order(moment), key=lambda step: not seen[step.tile])


def nearest_first(moment: Moment) -> list[Step]:
    """Layer by layer, in each the nearest tiles first; tiles that are not in the picture after all others."""
    boxes = tight_boxes(moment.index.cubes, None)
    seen, away = share_in_picture(boxes, moment.camera) > 0, distances(boxes, moment.camera.position)
    return sorted(file_order(moment), key=lambda step: (not seen[step.tile], step.layer, away[step.tile]))


def planned(moment: Moment) -> list[Step]:
    """The order planned by the gains in the file, once they have arrived."""
    return plan(moment.index, moment.streaming, moment.camera, moment.have)


def distances(boxes: Boxes, eye: F64) -> F64:
    """(T,) float64 from a place to the nearest point of each box, world units."""
    return np.asarray(np.linalg.norm(np.maximum(np.maximum(boxes.low - eye, eye - boxes.high), 0), axis=1))


class Oracle:
    """Plans by gains of the very view: the encoder's estimate, made from that view alone, some moments of a motion.

    Layer 1 of all tiles in the picture comes first, as in plans; then, by what is gained a byte, the layers of a tile
    that together gain most. Nothing that clients could be told makes gains better known.

    Args:
        scene: all integers of the file.
        index: of it.
        views: at ascending seconds.
    """

    def __init__(self, scene: QuantisedScene, index: SceneIndex, views: Sequence[tuple[float, drawing.Camera]]) -> None:
        self._seconds = np.array([seconds for seconds, _ in views])
        cameras = [view for _, view in views]
        streaming = told(scene, EncodeOptions(cameras=cameras), len(cameras))
        self._gains = [_gains_of(streaming, index, view) for view in cameras]

    def __call__(self, moment: Moment) -> list[Step]:
        """A plan by the gains known of the nearest moment."""
        gains, seen = self._gains[int(np.abs(self._seconds - moment.seconds).argmin())]
        first: list[tuple[float, int, int, int]] = []
        rest: list[tuple[float, int, int, int]] = []
        for tile, start in enumerate(moment.have):
            parts = _parts(gains[:, tile], moment.index.bytes[tile], start, bool(seen[tile]))
            for number, (worth, low, past) in enumerate(parts):
                begins = number == 0 and start == 0 and seen[tile]
                (first if begins else rest).append((-worth, low, tile, past))
        steps = sorted(first) + sorted(rest)
        return [Step(tile, layer) for _, low, tile, past in steps for layer in range(low, past + 1)]


def _gains_of(streaming: Streaming, index: SceneIndex, view: drawing.Camera) -> tuple[F64, F64]:
    """(L, T) what layers take away of the squared error of a view, and (T,) parts of tiles in its picture."""
    nearest = int(np.linalg.norm(streaming.viewpoints - view.centre, axis=1).argmin())
    here = slice(nearest, nearest + 1)
    alone = replace(streaming, viewpoints=streaming.viewpoints[here], gains=streaming.gains[here])
    boxes = tight_boxes(index.cubes, streaming)
    share = share_in_picture(boxes, planned_for(view), 1.0)
    gains = told_gains(view.centre, boxes, alone, index.bytes.shape[1])
    return gains * np.maximum(share, BEHIND)[:, None].T, share


def _parts(gains: F64, costs: F64, start: int, first_alone: bool) -> list[tuple[float, int, int]]:
    """Layers after `start` in parts, each the beginning of the rest that gains most a byte: worth, first, last."""
    out: list[tuple[float, int, int]] = []
    while start < len(gains):
        most = 1 if start == 0 and first_alone else len(gains)
        worth = np.cumsum(gains[start:most]) / np.maximum(np.cumsum(costs[start:most]), 1)
        best = int(worth.argmax())
        out.append((float(worth[best]), start + 1, start + best + 1))
        start += best + 1
    return out

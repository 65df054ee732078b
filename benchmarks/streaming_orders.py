"""Orders of fetching, and what a view looks like after so many bytes of each."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from reference_encoder.judge.finished import finished_gaussians
from scarfmt.arrays import F64
from scarfmt.blocks.streaming import Streaming
from scarfmt.coding.writer import QuantisedScene, keep_layers
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockKind
from scarfmt.container.source import BytesSource
from scarfmt.render import camera as drawing
from scarfmt.render.metrics import psnr
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.streaming.boxes import tight_boxes
from scarfmt.streaming.plan import SceneIndex, Step, plan
from scarfmt.streaming.view import Camera, share_in_picture

Order = Callable[[SceneIndex, Streaming | None, Camera], list[Step]]
MOST_DB = 100.0
"""PSNR of equal pictures, dB."""


def file_order(index: SceneIndex, _told: Streaming | None, _camera: Camera) -> list[Step]:
    """Layer by layer, tiles in Morton order."""
    return plan(index, None, None, [0] * len(index.bytes))


def culled(index: SceneIndex, told: Streaming | None, camera: Camera) -> list[Step]:
    """The planned order, with the tiles outside the picture after all others."""
    seen = share_in_picture(tight_boxes(index.cubes, None), camera) > 0
    return sorted(file_order(index, told, camera), key=lambda step: not seen[step.tile])


def without_gains(index: SceneIndex, _told: Streaming | None, camera: Camera) -> list[Step]:
    """The order planned for a file without gains."""
    return plan(index, None, camera, [0] * len(index.bytes))


def by_gains(index: SceneIndex, told: Streaming | None, camera: Camera) -> list[Step]:
    """The order planned by the gains in the file."""
    return plan(index, told, camera, [0] * len(index.bytes))


ORDERS: dict[str, tuple[Order, bool]] = {
    "file order": (file_order, False),
    "in view first": (culled, False),
    "planned, nothing told": (without_gains, False),
    "planned by gains": (by_gains, True),
}
"""By name: the order, and whether it needs the STREAMING block."""


def planned_for(view: drawing.Camera) -> Camera:
    """A view as planners have it."""
    pose, field = view.world_to_camera, 2 * math.atan(view.height / (2 * view.fy))
    return Camera(view.centre, pose[2, :3], -pose[1, :3], field, view.width, view.height)


class Film:
    """A scene of T tiles after any layer of each.

    Args:
        scene: all integers of it, explicit.
    """

    def __init__(self, scene: QuantisedScene) -> None:
        self.layers: list[GaussianScene] = []
        self.edges: list[F64] = []
        for layer in range(1, len(scene.model.layers) + 1):
            part = keep_layers(scene, layer)
            self.layers.append(_drawable(part))
            self.edges.append(np.concatenate([[0], np.cumsum([len(content) for content in part.contents])]))

    def picture(self, have: Sequence[int], view: drawing.Camera) -> F64:
        """The picture of tiles, each after a number of layers; black where there is nothing."""
        parts = []
        for layer, (gaussians, edges) in enumerate(zip(self.layers, self.edges, strict=True), start=1):
            ranges = [np.arange(edges[t], edges[t + 1]) for t, k in enumerate(have) if k == layer]
            if ranges:
                parts.append(gaussians.take(np.concatenate(ranges)))
        return drawn(parts, view)


def drawn(parts: Sequence[GaussianScene], view: drawing.Camera) -> F64:
    """The picture of some scenes together; black where there is nothing."""
    if not sum(map(len, parts)):
        return np.zeros((view.height, view.width, 3))
    return np.asarray(render(_joined(parts), view), np.float64)


def _drawable(scene: QuantisedScene) -> GaussianScene:
    """The Gaussians of a decode. A decoder of harmonics whose latents have not arrived adds nothing."""
    received = scene.model.max_stages > 0 or any(
        step for row in scene.model.layers[-1:] for steps in row.steps for step in _latent(scene, steps)
    )
    return finished_gaussians(scene if received else replace(scene, decoder=None))


def _latent(scene: QuantisedScene, steps: Sequence[int]) -> list[int]:
    return [n for n, channel in zip(steps, scene.model.channels, strict=True) if channel.stream.name == "LATENT"]


def _joined(parts: Sequence[GaussianScene]) -> GaussianScene:
    names = ("positions", "log_scales", "rotations", "opacity_logits", "sh")
    return GaussianScene(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


class Fetching:
    """The bytes of a file, step by step.

    Args:
        data: the file.
    """

    def __init__(self, data: bytes) -> None:
        container = Container.open(BytesSource(data)).load()
        self.index = SceneIndex.of(container)
        self.front = container.header.data_offset
        block = container.find(BlockKind.STREAMING, 1)
        self.told = 0 if block is None else block.length

    def sizes(self, steps: Sequence[Step], told: bool) -> F64:
        """Bytes that have come after each step, (n,): all models that it needs and, if `told`, the block."""
        models, total, out = 0, float(self.front + (self.told if told else 0)), []
        for tile, layer in steps:
            total += float(self.index.bytes[tile, layer - 1] + self.index.model_bytes[models:layer].sum())
            models = max(models, layer)
            out.append(total)
        return np.array(out)


def curve(film: Film, view: drawing.Camera, steps: Sequence[Step], sizes: F64, marks: F64) -> list[float]:
    """dB of the view against that of the whole file, after so many bytes."""
    tiles = len(film.edges[0]) - 1
    whole = film.picture([len(film.layers)] * tiles, view)
    have, found, done = [0] * tiles, [], 0
    for mark in marks:
        while done < len(steps) and sizes[done] <= mark:
            have[steps[done].tile] = steps[done].layer
            done += 1
        found.append(min(psnr(film.picture(have, view), whole), MOST_DB))
    return found


def bytes_to(decibels: float, marks: F64, found: Sequence[float]) -> float:
    """Bytes at which a curve first reaches so many dB, interpolated; the last mark if it does not."""
    reached = np.flatnonzero(np.array(found) >= decibels)
    if len(reached) == 0:
        return float(marks[-1])
    at = int(reached[0])
    if at == 0:
        return float(marks[0])
    part = (decibels - found[at - 1]) / (found[at] - found[at - 1])
    return float(marks[at - 1] + part * (marks[at] - marks[at - 1]))

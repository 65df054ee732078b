"""The STREAMING block of a file: tight boxes of tiles, and a view to begin with (SPEC §7.13)."""

from __future__ import annotations

import math

import numpy as np

from scarfmt.arrays import F64
from scarfmt.blocks.streaming import REACH_OF_SIDE, REACH_STEPS, Levels, Streaming, View
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.directory import tile_table
from scarfmt.render.camera import Camera
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from scarfmt.view_planning import cubes

_BULK = 0.9
"""Share of the visible content of a tile that sticks out of its box no further than its reach."""
_DEVIATIONS = 2.0


def build_streaming_block(scene: QuantisedScene, drawn: GaussianScene | AnchorModel, opening: Camera) -> Streaming:
    """The block of a file.

    Args:
        scene: all integers of the file.
        drawn: what a decoder makes of them, in file order.
        opening: the view to begin with.
    """
    return Streaming(*measure_boxes(scene, drawn), describe_view(opening, place_anchors(drawn).positions))


def describe_view(opening: Camera, positions: F64) -> View:
    """The view of a camera on (N, 3) `positions`: it looks at what is as far ahead as the middle of these."""
    low, middle, high = np.percentile(positions, (10, 50, 90), axis=0)
    forward, down = opening.world_to_camera[2, :3], opening.world_to_camera[1, :3]
    ahead = max(float((middle - opening.centre) @ forward), 0.05 * float(np.linalg.norm(high - low)), 1e-6)
    field = 2 * math.atan(opening.height / (2 * opening.fy))
    return View(opening.centre, opening.centre + ahead * forward, -down, field)


def place_anchors(scene: GaussianScene | AnchorModel) -> GaussianScene:
    """A Gaussian on every anchor of a model, of which only the place counts; an explicit scene as it is."""
    if isinstance(scene, GaussianScene):
        return scene
    n = len(scene)
    zeros = (np.zeros((n, 3), np.float32), np.zeros((n, 4), np.float32), np.zeros(n, np.float32))
    return GaussianScene(scene.anchors, *zeros, np.zeros((n, 1, 3), np.float32))


def _extents(drawn: GaussianScene | AnchorModel) -> tuple[F64, F64]:
    """(N,) how far what an anchor stands for reaches from its place, world units; and (N,) about how much it shows."""
    if isinstance(drawn, GaussianScene):
        extents = _DEVIATIONS * np.exp(drawn.log_scales.max(axis=1).astype(np.float64))
        return extents, extents**2 / (1 + np.exp(-drawn.opacity_logits.astype(np.float64)))
    scaling = np.exp(drawn.log_scaling.astype(np.float64))
    offsets = np.abs(drawn.offsets * scaling[:, None, :3]).max(axis=(1, 2), initial=0)
    extents = offsets + scaling[:, 3:].max(axis=1)
    return extents, extents**2


def measure_boxes(scene: QuantisedScene, drawn: GaussianScene | AnchorModel) -> tuple[Levels, Levels, Levels]:
    """Corners (T, 3), (T, 3) and reaches (T,) of tiles as the block has them; arguments as of the block."""
    every = cubes(scene.fields, tile_table(scene.tiles))
    corner, side = every[:, :3], every[:, 3] - every[:, 0]
    tiles, positions, (extents, weight) = len(side), place_anchors(drawn).positions, _extents(drawn)
    low, high, reach = np.zeros((tiles, 3), np.uint8), np.zeros((tiles, 3), np.uint8), np.zeros(tiles, np.uint8)
    edges = np.cumsum([0, *map(len, scene.contents)])
    for number in range(tiles):
        part = slice(edges[number], edges[number + 1])
        places = 256 * (positions[part] - corner[number]) / side[number]
        low[number] = np.clip(np.floor(places.min(axis=0)), 0, 255)
        high[number] = np.clip(np.maximum(np.ceil(places.max(axis=0)) - 1, low[number]), 0, 255)
        margin = np.minimum(places - low[number], high[number] + 1.0 - places).min(axis=1) * side[number] / 256
        sticking = np.maximum(extents[part] - margin, 0)
        order = np.argsort(sticking, kind="stable")
        total = np.cumsum(weight[part][order] + 1e-300)
        out = float(sticking[order][min(int(np.searchsorted(total, _BULK * total[-1])), len(order) - 1)])
        if out > 0:
            reach[number] = np.clip(math.ceil(REACH_OF_SIDE + REACH_STEPS * math.log2(out / side[number])), 1, 255)
    return low, high, reach

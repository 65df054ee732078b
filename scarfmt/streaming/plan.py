"""In which order to fetch layers of tiles. `web/src/plan/plan.ts` decides the same."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from scarfmt.arrays import F64, I64
from scarfmt.blocks.streaming import Streaming
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockKind
from scarfmt.streaming.boxes import cubes, tight_boxes
from scarfmt.streaming.gains import gains_from
from scarfmt.streaming.view import Camera, share_in_picture

BEHIND = 0.02
"""Part of a tile that counts as in the picture where none is: a camera may turn, and splats stick out."""
OVERHEAD = 64
"""Bytes that a block costs beside its own: its part of requests, and time to decode."""


class Step(NamedTuple):
    """A tile to be taken from the layer before to `layer`, from 1."""

    tile: int
    layer: int


@dataclass(frozen=True)
class SceneIndex:
    """The front of a file as a client needs it, for T tiles and L layers.

    Attributes:
        cubes: (T, 6) float64 lowest and highest corners, world units.
        bytes: (T, L) float64 of the TILE block, 0 where there is none.
        counts: (T, L) int64 anchors that first appear.
        model_bytes: (L,) float64 of the blocks that a layer needs besides its tiles.
        slots: Gaussians that an anchor stands for at most.
    """

    cubes: F64
    bytes: F64
    counts: I64
    model_bytes: F64
    slots: int = 1

    @classmethod
    def of(cls, container: Container) -> SceneIndex:
        """The index of an opened file."""
        header, rows = container.header, container.directory
        shape = header.tile_count, header.layer_count
        sizes, counts, models = np.zeros(shape), np.zeros(shape, np.int64), np.zeros(shape[1])
        tiles = rows[rows["kind"] == BlockKind.TILE]
        at = tiles["tile"].astype(np.int64), tiles["layer"].astype(np.int64) - 1
        sizes[at], counts[at] = tiles["length"], tiles["count"]
        others = rows[rows["kind"] < BlockKind.TILE]
        np.add.at(models, others["layer"].astype(np.int64) - 1, others["length"].astype(np.float64))
        return cls(cubes(header.fields, container.tile_table), sizes, counts, models, header.fields.slots)


def plan(index: SceneIndex, streaming: Streaming | None, camera: Camera | None, have: Sequence[int]) -> list[Step]:
    """All steps that are missing, in the order to fetch; those of one tile by layer.

    First layer 1 of every tile in the picture, so that there are no holes; then by what is gained a byte. A layer may
    gain little and the one after it much: of the layers of a tile that are missing, as many go together as gain most a
    byte. Equal gains go by layer, then tile. Without a camera the order is that of the file.

    Args:
        index: of the file.
        streaming: what it tells clients, or None.
        camera: to plan for.
        have: (T,) layers that each tile has.
    """
    tiles, layers = index.bytes.shape
    if camera is None:
        return [Step(tile, layer) for layer in range(1, layers + 1) for tile in range(tiles) if have[tile] < layer]
    gains, costs, share = weighed(index, streaming, camera, have)
    first, then = [], []
    for tile in range(tiles):
        start = have[tile]
        if start == 0 and layers > 0 and share[tile] > 0:
            first.append((-gains[tile, 0] / costs[tile, 0], 1, tile, 1))
            start = 1
        then += [(-worth, low, tile, past) for worth, low, past in _parts(gains[tile], costs[tile], start)]
    return [
        Step(tile, layer) for _, low, tile, past in sorted(first) + sorted(then) for layer in range(low, past + 1)
    ]


def weighed(
    index: SceneIndex, streaming: Streaming | None, camera: Camera, have: Sequence[int]
) -> tuple[F64, F64, F64]:
    """The basis of a plan: gains (T, L) of layers in this view, costs (T, L) in bytes, (T,) shares in the picture.

    Args:
        index, streaming, camera, have: as for :func:`plan`.
    """
    tiles, layers = index.bytes.shape
    boxes = tight_boxes(index.cubes, streaming)
    share = share_in_picture(boxes, camera)
    missing = np.where(np.arange(1, layers + 1) > max(have, default=0), index.model_bytes, 0.0)
    costs = index.bytes + OVERHEAD + missing / max(tiles, 1)
    gains = gains_from(camera.soon, boxes, streaming, costs.T).T * np.maximum(share, BEHIND)[:, None]
    return gains, costs, share


def _parts(gains: F64, costs: F64, start: int) -> Iterator[tuple[float, int, int]]:
    """The missing parts of a tile after layer `start`: for each its gain a byte, first layer and last layer.

    Each part is the beginning of the rest that gains most a byte, the shortest of equals.
    """
    while start < len(gains):
        best, past = -1.0, start
        gain = cost = 0.0
        for layer in range(start, len(gains)):
            gain, cost = gain + float(gains[layer]), cost + float(costs[layer])
            if gain / cost > best:
                best, past = gain / cost, layer + 1
        yield best, start + 1, past
        start = past


def affordable(index: SceneIndex, steps: Sequence[Step], *, size: float, splats: float) -> list[Step]:
    """The steps up to the first that does not fit: smaller ones after it would come and go as the camera moves.

    Args:
        index: of the file.
        steps: in the order of their use, from nothing.
        size: bytes of TILE blocks and models at most.
        splats: Gaussians at most.
    """
    models, taken, shown = 0, 0.0, 0.0
    for number, (tile, layer) in enumerate(steps):
        more = index.bytes[tile, layer - 1] + index.model_bytes[models:layer].sum()
        taken, shown = taken + more, shown + index.slots * index.counts[tile, layer - 1]
        if taken > size or shown > splats:
            return list(steps[:number])
        models = max(models, layer)
    return list(steps)

"""Level of detail: how many layers of each tile a view needs, within a number of Gaussians."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from reference_decoder.decode import DecodeRequest, Decoding, choose_tiles
from scarfmt.arrays import F64, I64
from scarfmt.blocks.streaming import read_streaming
from scarfmt.coding.reader import SceneReader
from scarfmt.container.directory import Table
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockKind, Profile
from scarfmt.container.source import ByteSource
from scarfmt.counters import Counters
from scarfmt.errors import InputWarning, InvalidInput, plural
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.view_planning import BEHIND, Camera, cubes, meets_picture, share_in_picture, solid_angle, tight_boxes

BLOCK_OVERHEAD = 64
"""Bytes that a block costs beside its own: its part of requests, and time to decode."""
LAYER_DECAY = 0.5
"""Gain of a byte of a layer, relative to a byte of the layer before."""
_FIRST, _OUTSIDE, _REFINES = 0, 1, 2
"""Ranks: layer 1 of tiles in the picture, so that there are no holes; layer 1 of others; what gains most."""


@dataclass(frozen=True)
class LevelOfDetail:
    """What a view needs of a scene.

    Attributes:
        camera: in world coordinates.
        budget: Gaussians at most; None for all that are in the picture.
        outside: whether tiles out of the picture get their first layer, and are not left out.
    """

    camera: Camera
    budget: int | None = None
    outside: bool = False


def select_tiles(source: ByteSource, request: DecodeRequest, view: LevelOfDetail) -> list[DecodeRequest]:
    """The requests that together decode what a view needs, one for each number of layers, ascending.

    Args:
        request: layers at most, tiles, box, limits.
        view: camera and budget.

    Raises:
        InvalidInput: the request does not fit the file.
        Malformed, Truncated, Unsupported, LimitExceeded: the front of the file is refused (SPEC §12).

    Warns:
        InputWarning: the view needs nothing: it shows no tile, or none fits into the budget.
    """
    reader = SceneReader(source, limits=request.limits, allow_truncated=request.allow_truncated)
    layers, tiles = reader.layer_number(request.layers), choose_tiles(reader, request)
    found = _layers_of_tiles(reader, view, layers, tiles)
    numbers = sorted(set(found.tolist()) - {0})
    return [replace(request, layers=number, tiles=tiles[found == number].tolist()) for number in numbers]


def iter_view(
    source: ByteSource, request: DecodeRequest, view: LevelOfDetail, counters: Counters | None = None
) -> Iterator[GaussianScene]:
    """The Gaussians that a view needs, a tile at a time. Arguments and errors of :func:`select_tiles`.

    Raises:
        InvalidInput: ``input-scene`` for an anchor model, which has no fixed Gaussians.
    """
    for each in select_tiles(source, request, view):
        decoding = Decoding(source, each, counters)
        if decoding.reader.header.fields.profile == Profile.ANCHOR:
            raise InvalidInput("input-scene", "an anchor model has no fixed Gaussians to choose for a view")
        yield from decoding.parts(decoding.gaussians)


@dataclass(frozen=True)
class _Parts:
    """Layers of tiles that are taken together or not at all, n of them.

    Attributes:
        tile: (n,) int64 row of the tile.
        low, high: (n,) int64 layers of the tile before and after.
        rank: (n,) int64.
        gain: (n,) float64 what is gained by a Gaussian.
        gaussians: (n,) int64 that come.
    """

    tile: I64
    low: I64
    high: I64
    rank: I64
    gain: F64
    gaussians: I64

    def take(self, index: NDArray[np.generic]) -> _Parts:
        return _Parts(*(column[index] for column in vars(self).values()))


def _layers_of_tiles(reader: SceneReader, view: LevelOfDetail, layers: int, tiles: I64) -> I64:
    """(n,) int64 layers of each of `tiles`, 0 for none."""
    container = reader.container
    fields = reader.header.fields
    sizes, gaussians = _block_sizes(container, container.directory)
    gaussians = fields.slots * gaussians
    boxes = tight_boxes(cubes(fields, container.tile_table), read_streaming(container))
    share = np.maximum(share_in_picture(boxes, view.camera), BEHIND)
    decay = LAYER_DECAY ** np.arange(1, sizes.shape[1] + 1)
    gains = (decay * solid_angle(boxes, view.camera.position_ahead)[:, None] * sizes) * share[:, None]
    visible = meets_picture(boxes, view.camera)[tiles]
    parts = _parts(gains[tiles, :layers], gaussians[tiles, :layers], visible, view.outside)
    taken = parts.take(_within(parts, math.inf if view.budget is None else view.budget))
    if not len(taken.tile):
        _warn_empty(parts)
    out = np.zeros(len(tiles), np.int64)
    np.maximum.at(out, taken.tile, taken.high)
    return out


def _warn_empty(parts: _Parts) -> None:
    if len(parts.tile):
        least = int(parts.gaussians[parts.low == 0].min())
        message = (
            f"no tile fits into the budget: the smallest first layer in the picture has {plural(least, 'Gaussian')}"
        )
    else:
        message = "nothing of the scene is in the picture"
    warnings.warn(message, InputWarning, stacklevel=2)


def _block_sizes(container: Container, rows: Table) -> tuple[F64, I64]:
    """(T, L) float64 bytes of TILE blocks, each with its share of the layer's models; (T, L) int64 new anchors."""
    shape = container.header.tile_count, container.header.layer_count
    sizes, counts, models = np.zeros(shape), np.zeros(shape, np.int64), np.zeros(shape[1])
    tiles, others = rows[rows["kind"] == BlockKind.TILE], rows[rows["kind"] < BlockKind.TILE]
    at = tiles["tile"].astype(np.int64), tiles["layer"].astype(np.int64) - 1
    sizes[at], counts[at] = tiles["length"], tiles["count"]
    np.add.at(models, others["layer"].astype(np.int64) - 1, others["length"].astype(np.float64))
    return sizes + BLOCK_OVERHEAD + models / max(shape[0], 1), counts


def _parts(gains: F64, gaussians: I64, visible: NDArray[np.bool_], outside: bool) -> _Parts:
    """The parts that can be taken, in the order to take them; equal parts by layer, then tile.

    Args:
        gains: (n, L) of the layers of n tiles.
        gaussians: (n, L) that each layer adds.
        visible: (n,) whether a tile may be in the picture.
        outside: whether the others get layer 1; else they get nothing.
    """
    at = np.arange(len(gains))
    rank = np.where(visible, _FIRST, _OUTSIDE)
    first = (at, np.zeros_like(at), np.ones_like(at), rank, gains[:, 0] / (gaussians[:, 0] + 1), gaussians[:, 0])
    parts = _Parts(*(np.concatenate(column) for column in zip(first, *_refinements(gains, gaussians), strict=True)))
    parts = parts.take(visible[parts.tile] | (outside & (parts.rank == _OUTSIDE)))
    return parts.take(np.lexsort((parts.tile, parts.low, -parts.gain, parts.rank)))


_Columns = tuple[I64, I64, I64, I64, F64, I64]


def _refinements(gains: F64, gaussians: I64) -> list[_Columns]:
    """The parts after layer 1. Each takes the next layers of the tile whose mean gain by a Gaussian is largest."""
    layers = gains.shape[1]
    start = np.ones(len(gains), np.int64)
    out: list[_Columns] = []
    while len(rest := np.flatnonzero(start < layers)):
        later = np.arange(layers) >= start[rest, None]
        gain, cost = (np.cumsum(np.where(later, values[rest], 0), axis=1) for values in (gains, gaussians))
        # One more: what refines without adding Gaussians costs next to nothing, but something.
        mean = np.where(later, gain / (cost + 1), -math.inf)
        last = mean.argmax(axis=1)
        at = np.arange(len(rest)), last
        out.append((rest, start[rest], last + 1, np.full(len(rest), _REFINES), mean[at], cost[at]))
        start[rest] = last + 1
    return out


def _within(parts: _Parts, budget: float) -> NDArray[np.bool_]:
    """(n,) bool parts that are taken of so many Gaussians, in order. Parts that do not fit are passed over."""
    total = np.cumsum(parts.gaussians)
    fit = int(np.searchsorted(total, budget, side="right"))
    taken = np.arange(len(total)) < fit
    left = budget - (float(total[fit - 1]) if fit else 0.0)
    missed: set[int] = set()
    rows = zip(parts.tile[fit:].tolist(), parts.gaussians[fit:].tolist(), strict=True)
    for number, (tile, gaussians) in enumerate(rows, start=fit):
        # What comes after a part that was left out needs that part.
        if gaussians > left or tile in missed:
            missed.add(tile)
        else:
            taken[number] = True
            left -= gaussians
    return taken

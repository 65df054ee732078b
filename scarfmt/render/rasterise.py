"""Tile rasteriser: pictures of Gaussian scenes, and what each Gaussian contributes to them.

The rules are INRIA's (3D Gaussian Splatting, appendix C): splats blended front to back, alpha capped at 0.99
and dropped below 1/255, a pixel closed before its transmittance would fall under 1e-4. All arithmetic is
float64 in a fixed order, so results are the same bits whatever the number of threads.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import prange
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64
from scarfmt.errors import InvalidInput
from scarfmt.render.camera import Camera
from scarfmt.render.jit import device, each_view, kernel
from scarfmt.render.projection import (
    BLUE,
    CONIC_A,
    CONIC_B,
    CONIC_C,
    FAINTEST,
    GREEN,
    HALF_X,
    HALF_Y,
    MAX_ALPHA,
    MEAN_X,
    MEAN_Y,
    MIN_ALPHA,
    MIN_TRANSMITTANCE,
    OPACITY,
    RED,
    SPLAT_COLUMNS,
    Drawable,
    project,
)
from scarfmt.scene.gaussians import GaussianScene

TILE = 16
PIXELS = TILE * TILE
# Planes of a tile's state, one value per pixel each: all in one array, so that LLVM can prove that they do
# not overlap and turns the loop over a row into vector code.
TRANSMITTANCE, OPEN, COLOUR, FINAL, LANES = 0, PIXELS, 2 * PIXELS, 5 * PIXELS, 8 * PIXELS
STATE = 8 * PIXELS + 4 * TILE
# Columns worked on together: enough for most splats, and for vectors.
_SPAN = TILE // 2
# Splats of at most so many columns are drawn pixel by pixel.
_NARROW = 3
# In place of where the hits of a splat of more columns end.
_WIDE = -1
# Splats between two looks at whether any pixel of the tile is still open.
_CHECK_EVERY = 16
# Splats of a tile are sorted by digits of their depths, few of them by comparison.
_FEW, _DIGIT_BITS = 512, 11
_DIGIT_MASK, _NUMBER_MASK, _KEY_SHIFT = np.uint64((1 << _DIGIT_BITS) - 1), np.uint64((1 << 32) - 1), np.uint64(32)


Hits = tuple[NDArray[np.int32], F64, NDArray[np.int64]]
"""Pixels of a tile that splats hit, one splat's behind another's; alphas there; where those of each splat end, or
`_WIDE`."""


Binned = tuple[NDArray[np.int64], NDArray[np.int32]]
"""Splats of a picture by tiles: where those of each tile begin in a list of splat numbers, and that list."""
_BLACK = (0.0, 0.0, 0.0)


@device
def bin_splats(splats: F64, depths: F32, columns: int, rows: int) -> Binned:
    """Splat numbers per tile, rising: (tiles + 1,) offsets into the (intersections,) list."""
    offsets = np.zeros(columns * rows + 1, dtype=np.int64)
    spans = np.empty((len(splats), 4), dtype=np.int16)
    for i in range(len(splats)):
        if depths[i] == np.inf:
            continue
        splat = splats[i]
        spans[i, 0] = int(max(0.0, (splat[MEAN_X] - splat[HALF_X]) / TILE))
        spans[i, 1] = int(min(float(columns - 1), (splat[MEAN_X] + splat[HALF_X]) / TILE))
        spans[i, 2] = int(max(0.0, (splat[MEAN_Y] - splat[HALF_Y]) / TILE))
        spans[i, 3] = int(min(float(rows - 1), (splat[MEAN_Y] + splat[HALF_Y]) / TILE))
        for row in range(spans[i, 2], spans[i, 3] + 1):
            for column in range(spans[i, 0], spans[i, 1] + 1):
                offsets[row * columns + column + 1] += 1
    for tile in range(columns * rows):
        offsets[tile + 1] += offsets[tile]
    fill = offsets[:-1].copy()
    members = np.empty(offsets[-1], dtype=np.int32)
    for i in range(len(splats)):
        if depths[i] == np.inf:
            continue
        for row in range(spans[i, 2], spans[i, 3] + 1):
            for column in range(spans[i, 0], spans[i, 1] + 1):
                tile = row * columns + column
                members[fill[tile]] = i
                fill[tile] += 1
    return offsets, members


@device
def gathered_splats(splats: F64, members: NDArray[np.integer[Any]]) -> F64:
    """Copies of the splats of a tile side by side: what is drawn in order of depth is better not far apart."""
    gathered = np.empty((len(members), SPLAT_COLUMNS))
    for k in range(len(members)):
        source, target = splats[members[k]], gathered[k]
        for column in range(SPLAT_COLUMNS):
            target[column] = source[column]
    return gathered


@device
def nearest_first(depths: F32, members: NDArray[np.int32]) -> NDArray[np.uint64]:
    """Order of the `members` of a tile by depth, nearest first. Of two at equal depth the first comes first.

    Sorted by the bits of depths, which for positive floats order like their values: those of many members by digits,
    three times as fast.
    """
    keys = depths.view(np.uint32)
    entries = np.empty(len(members), dtype=np.uint64)
    for k in range(len(members)):
        entries[k] = (np.uint64(keys[members[k]]) << _KEY_SHIFT) | np.uint64(k)
    if len(members) < _FEW:
        return np.sort(entries) & _NUMBER_MASK
    spare = np.empty(len(members), dtype=np.uint64)
    for digit in range(3):
        shift = _KEY_SHIFT + np.uint64(digit * _DIGIT_BITS)
        starts = np.zeros((1 << _DIGIT_BITS) + 1, dtype=np.int64)
        for k in range(len(entries)):
            starts[((entries[k] >> shift) & _DIGIT_MASK) + np.uint64(1)] += 1
        for value in range(1 << _DIGIT_BITS):
            starts[value + 1] += starts[value]
        for k in range(len(entries)):
            value = (entries[k] >> shift) & _DIGIT_MASK
            spare[starts[value]] = entries[k]
            starts[value] += 1
        entries, spare = spare, entries
    return entries & _NUMBER_MASK


@device
def first_row_of(splat: F64, top: float) -> int:
    """First row of the tile starting at `top` whose pixel centres the splat can reach."""
    return int(max(0.0, np.ceil(splat[MEAN_Y] - splat[HALF_Y] - top - 0.5)))


@device
def last_row_of(splat: F64, top: float) -> int:
    """Last such row, less than `TILE`."""
    return int(min(TILE - 1.0, np.floor(splat[MEAN_Y] + splat[HALF_Y] - top - 0.5)))


@device
def columns_of(splat: F64, left: float) -> tuple[int, int]:
    """First and last column of the tile starting at `left` whose pixel centres the splat can reach."""
    first = int(max(0.0, np.ceil(splat[MEAN_X] - splat[HALF_X] - left - 0.5)))
    return first, int(min(TILE - 1.0, np.floor(splat[MEAN_X] + splat[HALF_X] - left - 0.5)))


@device
def _spans(first: int, last: int) -> tuple[int, int]:
    """First of the columns to work on together, and the column after the last: one span or all."""
    if last - first >= _SPAN:
        return 0, TILE
    begin = min(first, TILE - _SPAN)
    return begin, begin + _SPAN


@device
def open_tile(state: F64, wide: int, high: int) -> None:
    """Start a tile of which `wide` x `high` pixels lie in the picture; the others count as closed."""
    for pixel in range(PIXELS):
        state[TRANSMITTANCE + pixel] = 1.0
        state[OPEN + pixel] = 1.0 if pixel % TILE < wide and pixel // TILE < high else 0.0
        state[COLOUR + pixel] = 0.0
        state[COLOUR + PIXELS + pixel] = 0.0
        state[COLOUR + 2 * PIXELS + pixel] = 0.0


@device
def _tile_is_open(state: F64) -> bool:
    still_open = 0.0
    for pixel in range(PIXELS):
        still_open = max(still_open, state[OPEN + pixel])
    return still_open > 0.0


@device
def _exp(power: float) -> float:
    """exp(power) for -8 <= power <= 0 to 1e-8; written out because a call would stop vectorisation.

    Below -8 any value under 1/255 will do, as every alpha there is dropped.
    """
    t = max(power, -8.0) * (1.0 / 128.0)
    value = 1.0 + t * (1.0 + t * (1 / 2 + t * (1 / 6 + t * (1 / 24 + t * (1 / 120)))))
    value *= value
    value *= value
    value *= value
    value *= value
    value *= value
    value *= value
    value *= value
    return value


@device
def alpha_at(opacity: float, power: float) -> float:
    """Alpha of a splat at a pixel; 0 where the rules say to skip it."""
    alpha = min(MAX_ALPHA, opacity * _exp(power))
    return 0.0 if (power > 0.0 or alpha < MIN_ALPHA) else alpha


@device
def shade(planes: F64, pixel: int, alpha: float, red: float, green: float, blue: float) -> tuple[float, float]:
    """Blend a colour over a pixel of `planes`; its weight there, and the transmittance behind it.

    The one statement of the image model: pictures and sensitivities both follow it.
    """
    before = planes[TRANSMITTANCE + pixel]
    after = before * (1.0 - alpha)
    still = planes[OPEN + pixel] if after >= MIN_TRANSMITTANCE else 0.0
    weight = alpha * before * still
    planes[OPEN + pixel] = still
    planes[TRANSMITTANCE + pixel] = after if still > 0.0 else before
    planes[COLOUR + pixel] += weight * red
    planes[COLOUR + PIXELS + pixel] += weight * green
    planes[COLOUR + 2 * PIXELS + pixel] += weight * blue
    return weight, after


@device
def colour_behind(planes: F64, place: int) -> float:
    """One colour of a pixel behind the splats blended so far: the finished picture minus what is blended."""
    behind: float = planes[FINAL + place] - planes[COLOUR + place]
    return behind


@device
def _contrast(planes: F64, pixel: int, alpha: float, red: float, green: float, blue: float) -> tuple[float, float]:
    """Blend as :func:`shade`; the weight, and the squared distance of the colour from what is behind."""
    weight, after = shade(planes, pixel, alpha, red, green, blue)
    share = 1.0 / max(after, MIN_TRANSMITTANCE)
    over_red = red - colour_behind(planes, pixel) * share
    over_green = green - colour_behind(planes, pixel + PIXELS) * share
    over_blue = blue - colour_behind(planes, pixel + 2 * PIXELS) * share
    return weight, over_red * over_red + over_green * over_green + over_blue * over_blue


@device
def _blend(state: F64, splat: F64, left: float, top: float) -> None:
    """Blend one splat over the tile whose first pixel is (left, top)."""
    a, b, c = -0.5 * splat[CONIC_A], -splat[CONIC_B], -0.5 * splat[CONIC_C]
    opacity, red, green, blue = splat[OPACITY], splat[RED], splat[GREEN], splat[BLUE]
    dx0 = left + 0.5 - splat[MEAN_X]
    first_row, last_row = first_row_of(splat, top), last_row_of(splat, top)
    first, last = columns_of(splat, left)
    if last - first < _NARROW:
        faintest = splat[FAINTEST]
        for row in range(first_row, last_row + 1):
            dy = top + row + 0.5 - splat[MEAN_Y]
            for column in range(first, last + 1):
                if state[OPEN + row * TILE + column] > 0.0:
                    dx = dx0 + column
                    power = a * dx * dx + b * dx * dy + c * dy * dy
                    alpha = alpha_at(opacity, power) if power > faintest else 0.0
                    if alpha > 0.0:
                        shade(state, row * TILE + column, alpha, red, green, blue)
    else:
        _blend_wide(state, splat, left, top)


@device
def _blend_wide(state: F64, splat: F64, left: float, top: float) -> None:
    """Blend a splat of many columns."""
    a, b, c = -0.5 * splat[CONIC_A], -splat[CONIC_B], -0.5 * splat[CONIC_C]
    opacity, red, green, blue = splat[OPACITY], splat[RED], splat[GREEN], splat[BLUE]
    dx0 = left + 0.5 - splat[MEAN_X]
    first_row, last_row = first_row_of(splat, top), last_row_of(splat, top)
    first, last = columns_of(splat, left)
    # Constant loop bounds let LLVM see that no index is negative, without which it does not vectorise.
    begin, end = _spans(first, last)
    for first_column in range(begin, end, _SPAN):
        planes = state[first_column:]
        for row in range(TILE):
            if row < first_row or row > last_row:
                continue
            dy = top + row + 0.5 - splat[MEAN_Y]
            for place in range(_SPAN):
                pixel = row * TILE + place
                dx = dx0 + (first_column + place)
                alpha = alpha_at(opacity, a * dx * dx + b * dx * dy + c * dy * dy)
                shade(planes, pixel, alpha, red, green, blue)


@device
def composite_tile(
    state: F64, splats: F64, order: NDArray[np.uint64], left: float, top: float, wide: int, high: int
) -> int:
    """Blend the tile's splats in `order` until all pixels are closed; how many were blended."""
    open_tile(state, wide, high)
    for k in range(len(order)):
        if k % _CHECK_EVERY == 0 and not _tile_is_open(state):
            return k
        _blend(state, splats[order[k]], left, top)
    return len(order)


@kernel
def _render_tiles(
    splats: F64,
    depths: F32,
    offsets: NDArray[np.int64],
    members: NDArray[np.int32],
    tiles: NDArray[np.int64],
    columns: int,
    background: F64,
    image: F32,
) -> None:
    for k in prange(len(tiles)):
        tile = tiles[k]
        row, column = tile // columns, tile % columns
        wide, high = min(TILE, image.shape[1] - column * TILE), min(TILE, image.shape[0] - row * TILE)
        here, state = members[offsets[tile] : offsets[tile + 1]], np.empty(STATE)
        order = nearest_first(depths, here)
        composite_tile(state, gathered_splats(splats, here), order, float(column * TILE), float(row * TILE), wide, high)
        for y in range(high):
            for x in range(wide):
                pixel = y * TILE + x
                for channel in range(3):
                    behind = state[TRANSMITTANCE + pixel] * background[channel]
                    colour = state[COLOUR + channel * PIXELS + pixel]
                    image[row * TILE + y, column * TILE + x, channel] = colour + behind


@device
def _footprints(splats: F64, left: float, top: float) -> tuple[NDArray[np.int8], int]:
    """First and last column, first and last row that splats can reach in a tile, a row for each splat.

    Also the pixels that the narrow ones can reach, each as often as there are splats that do.
    """
    spans, room = np.empty((len(splats), 4), np.int8), 0
    for k in range(len(splats)):
        first, last = columns_of(splats[k], left)
        first_row, last_row = first_row_of(splats[k], top), last_row_of(splats[k], top)
        spans[k, 0], spans[k, 1], spans[k, 2], spans[k, 3] = first, last, first_row, last_row
        if last - first < _NARROW:
            room += max(0, last - first + 1) * max(0, last_row - first_row + 1)
    return spans, room


@device
def _is_closed(state: F64, spans: NDArray[np.int8], at: np.int64) -> bool:
    """Whether no pixel of a footprint is open."""
    for row in range(spans[at, 2], spans[at, 3] + 1):
        for column in range(spans[at, 0], spans[at, 1] + 1):
            if state[OPEN + row * TILE + column] > 0.0:
                return False
    return True


@device
def _find_hits(state: F64, splat: F64, span: NDArray[np.int8], left: float, top: float, hits: Hits, filled: int) -> int:
    """Add to `hits` the open pixels where a narrow splat shows; how many there are then."""
    pixels, alphas, _ = hits
    a, b, c = -0.5 * splat[CONIC_A], -splat[CONIC_B], -0.5 * splat[CONIC_C]
    opacity, faintest = splat[OPACITY], splat[FAINTEST]
    dx0 = left + 0.5 - splat[MEAN_X]
    for row in range(span[2], span[3] + 1):
        dy = top + row + 0.5 - splat[MEAN_Y]
        for column in range(span[0], span[1] + 1):
            if state[OPEN + row * TILE + column] > 0.0:
                dx = dx0 + column
                power = a * dx * dx + b * dx * dy + c * dy * dy
                alpha = alpha_at(opacity, power) if power > faintest else 0.0
                if alpha > 0.0:
                    pixels[filled], alphas[filled] = row * TILE + column, alpha
                    filled += 1
    return filled


@device
def _composite_hits(
    state: F64, splats: F64, spans: NDArray[np.int8], order: NDArray[np.uint64], left: float, top: float, hits: Hits
) -> int:
    """Blend splats as :func:`composite_tile` does and note what narrow ones hit; how many were looked at.

    Finding hits takes longer than blending them. Most splats of a large scene are behind closed pixels, which their
    footprints tell.
    """
    pixels, alphas, ends = hits
    filled = 0
    for k in range(len(order)):
        if k % _CHECK_EVERY == 0 and not _tile_is_open(state):
            return k
        ends[k] = filled
        at = np.int64(order[k])
        if _is_closed(state, spans, at):
            continue
        span, splat = spans[at], splats[at]
        if span[1] - span[0] < _NARROW:
            past = _find_hits(state, splat, span, left, top, hits, filled)
            for hit in range(filled, past):
                shade(state, pixels[hit], alphas[hit], splat[RED], splat[GREEN], splat[BLUE])
            ends[k] = filled = past
        else:
            _blend_wide(state, splat, left, top)
            ends[k] = _WIDE
    return len(order)


@device
def _measure_hits(state: F64, splat: F64, hits: Hits, start: int, past: int, out: F64) -> None:
    """Blend a narrow splat anew where it hits; fill `out` as :func:`_measure_wide` does."""
    pixels, alphas, _ = hits
    red, green, blue = splat[RED], splat[GREEN], splat[BLUE]
    weight_sum, weight_sq, contrast_sq, weight_max = 0.0, 0.0, 0.0, 0.0
    for hit in range(start, past):
        weight, contrast = _contrast(state, pixels[hit], alphas[hit], red, green, blue)
        weight_sum += weight
        weight_sq += weight * weight
        contrast_sq += weight * weight * contrast
        weight_max = max(weight_max, weight)
    out[0], out[1], out[2], out[3] = weight_sum, weight_sq, contrast_sq, weight_max


@device
def _measure_wide(state: F64, splat: F64, left: float, top: float, out: F64) -> None:
    """Blend a splat of many columns; fill `out` with its sums of w, w^2 and contrast, and its largest w.

    Needs the finished picture in the `FINAL` planes: what lies behind is what is finished less what is in front.
    """
    a, b, c = -0.5 * splat[CONIC_A], -splat[CONIC_B], -0.5 * splat[CONIC_C]
    opacity, red, green, blue = splat[OPACITY], splat[RED], splat[GREEN], splat[BLUE]
    dx0 = left + 0.5 - splat[MEAN_X]
    first_row, last_row = first_row_of(splat, top), last_row_of(splat, top)
    first, last = columns_of(splat, left)
    for lane in range(4 * TILE):
        state[LANES + lane] = 0.0
    begin, end = _spans(first, last)
    for first_column in range(begin, end, _SPAN):
        planes = state[first_column:]
        for row in range(TILE):
            if row < first_row or row > last_row:
                continue
            dy = top + row + 0.5 - splat[MEAN_Y]
            for place in range(_SPAN):
                pixel = row * TILE + place
                dx = dx0 + (first_column + place)
                alpha = alpha_at(opacity, a * dx * dx + b * dx * dy + c * dy * dy)
                weight, contrast = _contrast(planes, pixel, alpha, red, green, blue)
                squared = weight * weight
                largest = planes[LANES + 3 * TILE + place]
                planes[LANES + place] += weight
                planes[LANES + TILE + place] += squared
                planes[LANES + 2 * TILE + place] += squared * contrast
                planes[LANES + 3 * TILE + place] = weight if weight > largest else largest
    for quantity in range(4):
        out[quantity] = 0.0
    for column in range(TILE):
        for quantity in range(3):
            out[quantity] += state[LANES + quantity * TILE + column]
        out[3] = max(out[3], state[LANES + 3 * TILE + column])


@kernel
def _measure_tiles(
    splats: F64,
    depths: F32,
    offsets: NDArray[np.int64],
    members: NDArray[np.int32],
    tiles: NDArray[np.int64],
    columns: int,
    size: NDArray[np.int64],
    measures: F64,
) -> None:
    """Fill `measures` (intersections, 4): one row for each splat in each tile, so that no two threads share one."""
    for k in prange(len(tiles)):
        tile = tiles[k]
        row, column = tile // columns, tile % columns
        left, top = float(column * TILE), float(row * TILE)
        wide, high = min(TILE, size[0] - column * TILE), min(TILE, size[1] - row * TILE)
        first, last = offsets[tile], offsets[tile + 1]
        here, state = members[first:last], np.empty(STATE)
        order = nearest_first(depths, here)
        near = gathered_splats(splats, here)
        spans, room = _footprints(near, left, top)
        hits = np.empty(room, np.int32), np.empty(room), np.zeros(len(order), np.int64)
        open_tile(state, wide, high)
        seen = _composite_hits(state, near, spans, order, left, top, hits)
        for channel in range(3):
            for pixel in range(PIXELS):
                state[FINAL + channel * PIXELS + pixel] = state[COLOUR + channel * PIXELS + pixel]
        open_tile(state, wide, high)
        measures[first:last] = 0.0
        start, ends = 0, hits[2]
        for k in range(seen):
            if ends[k] == _WIDE:
                _measure_wide(state, near[order[k]], left, top, measures[first + order[k]])
            elif ends[k] > start:
                _measure_hits(state, near[order[k]], hits, start, ends[k], measures[first + order[k]])
                start = ends[k]


@device
def _gather(measures: F64, members: NDArray[np.int32], count: int) -> F64:
    """(count, 4) `measures` of each splat of a view, added in the order of the tiles; of the last, the largest."""
    sums = np.zeros((count, 4))
    for k in range(len(members)):
        if measures[k, 3] > 0.0:
            row = sums[members[k]]
            for quantity in range(3):
                row[quantity] += measures[k, quantity]
            row[3] = max(row[3], measures[k, 3])
    return sums


def spread(tiles: int) -> NDArray[np.int64]:
    """(tiles,) int64: all tile numbers, always in the same shuffled order, so that threads share busy areas."""
    return np.random.default_rng(0).permutation(tiles)


def _check(scene: GaussianScene, colours: NDArray[np.floating] | None) -> F64 | None:
    if colours is None:
        return None
    if colours.shape != (len(scene), 3):
        raise InvalidInput("input-shape", f"expected ({len(scene)}, 3) colours, got {colours.shape}", field="colours")
    return np.ascontiguousarray(colours, dtype=np.float64)


def render(
    scene: GaussianScene | Drawable,
    camera: Camera,
    background: Sequence[float] = _BLACK,
    sh_degree: int | None = None,
    colours: NDArray[np.floating] | None = None,
) -> F32:
    """The picture of a scene, (height, width, 3) float32, linear in the scene's colours and not clipped above.

    Args:
        scene: the N Gaussians.
        camera: where from.
        background: colour behind everything.
        sh_degree: use spherical-harmonic bands up to this degree only; default all.
        colours: (N, 3) colours to use instead of the spherical harmonics (anchor models give these).

    Raises:
        InvalidInput: `colours` has the wrong shape.
    """
    drawable = Drawable.of(scene)
    splats, depths, _ = project(drawable, camera, sh_degree, _check(drawable.scene, colours))
    return _drawn(splats, depths, _binned(splats, depths, camera), camera, background)


def render_with(scene: GaussianScene | Drawable, camera: Camera, colours: NDArray[np.floating]) -> tuple[F32, F32]:
    """Two pictures, as :func:`render` makes them: in the scene's colours, and in others.

    What is where is found once for both.

    Args:
        scene: the N Gaussians.
        camera: where from.
        colours: (N, 3) the other colours.

    Raises:
        InvalidInput: `colours` has the wrong shape.
    """
    drawable = Drawable.of(scene)
    others = _check(drawable.scene, colours)
    assert others is not None
    splats, depths, index = project(drawable, camera)
    binned = _binned(splats, depths, camera)
    own = _drawn(splats, depths, binned, camera, _BLACK)
    splats[:, RED : BLUE + 1] = others[index]
    return own, _drawn(splats, depths, binned, camera, _BLACK)


def _binned(splats: F64, depths: F32, camera: Camera) -> Binned:
    return bin_splats(splats, depths, -(-camera.width // TILE), -(-camera.height // TILE))


def _drawn(splats: F64, depths: F32, binned: Binned, camera: Camera, background: Sequence[float]) -> F32:
    """The picture of splats that are in tiles, (height, width, 3)."""
    columns, rows = -(-camera.width // TILE), -(-camera.height // TILE)
    image = np.empty((camera.height, camera.width, 3), dtype=np.float32)
    behind = np.asarray(background, dtype=np.float64)
    _render_tiles(splats, depths, *binned, spread(columns * rows), columns, behind, image)
    return image


@dataclass(frozen=True)
class Contributions:
    """The contributions of V Gaussians to one picture; all other Gaussians contribute nothing.

    The weight of a Gaussian at a pixel is w = alpha * transmittance.

    Attributes:
        index: (V,) int64 rising, which Gaussians.
        weight_sum: (V,) float64, sum of w over all pixels.
        weight_sq: (V,) float64, sum of w^2.
        weight_max: (V,) float64, largest w, 0..0.99.
        contrast_sq: (V,) float64, sum over pixels of w^2 |c - c_behind|^2 (summed over R, G, B), with c_behind
            the colour composited behind the Gaussian divided by the transmittance there: the square of
            alpha * d(pixel)/d(alpha), i.e. how much a relative error of alpha is seen.
    """

    index: NDArray[np.int64]
    weight_sum: F64
    weight_sq: F64
    weight_max: F64
    contrast_sq: F64


def contributions_by_view(
    scene: GaussianScene | Drawable,
    cameras: Iterable[Camera],
    colours: NDArray[np.floating] | None = None,
) -> Iterator[Contributions]:
    """How much each Gaussian shows in the picture from each of `cameras`, and how sensitive that is to it.

    Args:
        scene: the N Gaussians.
        cameras: the views; what is behind the scene is black.
        colours: as for :func:`render`.

    Raises:
        InvalidInput: `colours` has the wrong shape.
    """
    drawable = Drawable.of(scene)
    fixed = _check(drawable.scene, colours)

    def contributed(camera: Camera) -> Contributions:
        columns, rows = -(-camera.width // TILE), -(-camera.height // TILE)
        size = np.array([camera.width, camera.height], dtype=np.int64)
        splats, depths, index = project(drawable, camera, colours=fixed)
        offsets, members = bin_splats(splats, depths, columns, rows)
        measures = np.empty((len(members), 4))
        _measure_tiles(splats, depths, offsets, members, spread(columns * rows), columns, size, measures)
        sums = _gather(measures, members, len(splats))
        seen = np.flatnonzero(sums[:, 3] > 0)
        weight_sum, weight_sq, contrast_sq, weight_max = sums[seen].T
        return Contributions(index[seen].astype(np.int64), weight_sum, weight_sq, weight_max, contrast_sq)

    yield from each_view(contributed, cameras)

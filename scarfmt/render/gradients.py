"""How a picture changes with each Gaussian: the derivatives that fitting a scene to pictures follows.

The derivatives of :mod:`scarfmt.render.rasterise`'s image model, by its own blend. What stays as it is: which pixels a
splat reaches, the order of splats, and the projection's Jacobian where only the centre moves. An alpha that is capped
does not change with its splat, nor does a colour that is clamped at 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import prange
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64
from scarfmt.errors import InvalidInput
from scarfmt.render.camera import Camera
from scarfmt.render.jit import device, kernel
from scarfmt.render.projection import (
    BLUE,
    CONIC_A,
    CONIC_B,
    CONIC_C,
    FAINTEST,
    FRUSTUM_MARGIN,
    GREEN,
    MAX_ALPHA,
    MEAN_X,
    MEAN_Y,
    MIN_TRANSMITTANCE,
    OPACITY,
    RED,
    Drawable,
    project,
)
from scarfmt.render.rasterise import (
    COLOUR,
    FINAL,
    PIXELS,
    STATE,
    TILE,
    alpha_at,
    bin_splats,
    colour_behind,
    columns_of,
    composite_tile,
    first_row_of,
    gathered_splats,
    last_row_of,
    nearest_first,
    open_tile,
    shade,
    spread,
)

# Columns of the sums over a splat's pixels: colour, then g, g dx, g dy, g dx^2, g dx dy, g dy^2, where g is the
# derivative by ln(alpha) and (dx, dy) leads from the splat's centre to the pixel.
_SUMS = 9
# Columns of what a Gaussian's derivatives are gathered in.
_COLOUR, _OPACITY, _SCALE, _TURN, _PLACE, _COLUMNS = 0, 3, 4, 7, 10, 13


@dataclass(frozen=True)
class Gradients:
    """Derivatives of a loss by V Gaussians that a picture shows; by all others it is 0.

    Attributes:
        index: (V,) int64 rising, which Gaussians.
        colour: (V, 3) float64, by the colour the camera sees.
        logit: (V,) float64, by the opacity's logit.
        log_scale: (V, 3) float64.
        turn: (V, 3) float64, by small turns about the Gaussian's own axes, radians.
        position: (V, 3) float64, 1 / world units.
    """

    index: NDArray[np.int64]
    colour: F64
    logit: F64
    log_scale: F64
    turn: F64
    position: F64


@device
def _sum_splat(state: F64, slopes: F64, splat: F64, left: float, top: float, out: F64) -> None:
    """Blend one splat and fill `out` with its sums: `state` holds the finished picture, `slopes` d(loss) by it."""
    a, b, c = -0.5 * splat[CONIC_A], -splat[CONIC_B], -0.5 * splat[CONIC_C]
    opacity, faintest = splat[OPACITY], splat[FAINTEST]
    red, green, blue = splat[RED], splat[GREEN], splat[BLUE]
    first, last = columns_of(splat, left)
    for quantity in range(_SUMS):
        out[quantity] = 0.0
    for row in range(first_row_of(splat, top), last_row_of(splat, top) + 1):
        dy = top + row + 0.5 - splat[MEAN_Y]
        for column in range(first, last + 1):
            dx = left + column + 0.5 - splat[MEAN_X]
            power = a * dx * dx + b * dx * dy + c * dy * dy
            alpha = alpha_at(opacity, power) if power > faintest else 0.0
            if alpha == 0.0:
                continue
            pixel = row * TILE + column
            weight, after = shade(state, pixel, alpha, red, green, blue)
            if weight == 0.0:
                continue
            slope_red, slope_green, slope_blue = slopes[pixel], slopes[PIXELS + pixel], slopes[2 * PIXELS + pixel]
            out[0] += weight * slope_red
            out[1] += weight * slope_green
            out[2] += weight * slope_blue
            if alpha >= MAX_ALPHA:
                continue
            share = 1.0 / max(after, MIN_TRANSMITTANCE)
            by_alpha = weight * (
                slope_red * (red - colour_behind(state, pixel) * share)
                + slope_green * (green - colour_behind(state, pixel + PIXELS) * share)
                + slope_blue * (blue - colour_behind(state, pixel + 2 * PIXELS) * share)
            )
            out[3] += by_alpha
            out[4] += by_alpha * dx
            out[5] += by_alpha * dy
            out[6] += by_alpha * dx * dx
            out[7] += by_alpha * dx * dy
            out[8] += by_alpha * dy * dy


@kernel
def _sum_tiles(
    splats: F64,
    depths: F32,
    offsets: NDArray[np.int64],
    members: NDArray[np.int32],
    tiles: NDArray[np.int64],
    columns: int,
    target: F32,
    sums: F64,
    errors: F64,
) -> None:
    """Fill `sums` (intersections, 9), one row for each splat in each tile, and `errors` (tiles,), of squares."""
    for k in prange(len(tiles)):
        tile = tiles[k]
        row, column = tile // columns, tile % columns
        left, top = float(column * TILE), float(row * TILE)
        wide, high = min(TILE, target.shape[1] - column * TILE), min(TILE, target.shape[0] - row * TILE)
        first, last = offsets[tile], offsets[tile + 1]
        here, state, slopes = members[first:last], np.empty(STATE), np.zeros(3 * PIXELS)
        order, near = nearest_first(depths, here), gathered_splats(splats, here)
        seen = composite_tile(state, near, order, left, top, wide, high)
        for channel in range(3):
            for pixel in range(PIXELS):
                state[FINAL + channel * PIXELS + pixel] = state[COLOUR + channel * PIXELS + pixel]
        error = 0.0
        for y in range(high):
            for x in range(wide):
                for channel in range(3):
                    place = channel * PIXELS + y * TILE + x
                    slopes[place] = state[FINAL + place] - target[row * TILE + y, column * TILE + x, channel]
                    error += slopes[place] * slopes[place]
        errors[tile] = error
        open_tile(state, wide, high)
        for place in range(seen):
            _sum_splat(state, slopes, near[order[place]], left, top, sums[first + order[place]])
        for place in range(seen, len(order)):
            sums[first + order[place]] = 0.0


@device
def _added(sums: F64, members: NDArray[np.int32], count: int) -> F64:
    """(count, 9) `sums` of each splat, added in the order of the tiles."""
    total = np.zeros((count, _SUMS))
    for k in range(len(members)):
        for quantity in range(_SUMS):
            total[members[k], quantity] += sums[k, quantity]
    return total


@device
def _axes_seen(position: F64, axes: F64, pose: F64, lens: F64, jacobian: F64, seen: F64) -> None:
    """Fill d(pixel) by the position (2, 3), with the slopes that the projection clamps, and the axes in the picture."""
    fx, fy, width, height = lens[0], lens[1], lens[4], lens[5]
    limit_x, limit_y = FRUSTUM_MARGIN * width / (2.0 * fx), FRUSTUM_MARGIN * height / (2.0 * fy)
    x, y, z = pose[0, 3], pose[1, 3], pose[2, 3]
    for k in range(3):
        x, y, z = x + pose[0, k] * position[k], y + pose[1, k] * position[k], z + pose[2, k] * position[k]
    tx, ty = min(limit_x, max(-limit_x, x / z)), min(limit_y, max(-limit_y, y / z))
    for k in range(3):
        jacobian[0, k] = fx / z * (pose[0, k] - tx * pose[2, k])
        jacobian[1, k] = fy / z * (pose[1, k] - ty * pose[2, k])
    for row in range(2):
        for k in range(3):
            seen[row, k] = 0.0
            for i in range(3):
                seen[row, k] += jacobian[row, i] * axes[3 * i + k]


@kernel
def _to_gaussians(
    index: NDArray[np.int32],
    splats: F64,
    sums: F64,
    positions: F64,
    shapes: F64,
    log_scales: F32,
    pose: F64,
    lens: F64,
    out: F64,
) -> None:
    """From sums over a splat's pixels to the derivatives by its Gaussian: `out` (V, 13)."""
    for row in prange(len(index)):
        i, splat, total, mine = index[row], splats[row], sums[row], out[row]
        for channel in range(3):
            mine[_COLOUR + channel] = total[channel] if splat[RED + channel] > 0.0 else 0.0
        mine[_OPACITY] = total[3] * (1.0 - splat[OPACITY])
        jacobian, seen = np.empty((2, 3)), np.empty((2, 3))
        _axes_seen(positions[i], shapes[i], pose, lens, jacobian, seen)
        a, b, c = splat[CONIC_A], splat[CONIC_B], splat[CONIC_C]
        by_x, by_y = a * total[4] + b * total[5], b * total[4] + c * total[5]
        for k in range(3):
            mine[_PLACE + k] = jacobian[0, k] * by_x + jacobian[1, k] * by_y
        # By the covariance: conic * (sum of g d d^T) * conic / 2.
        p, q, r, s = a * total[6] + b * total[7], a * total[7] + b * total[8], b * total[6] + c * total[7], b * total[7]
        s += c * total[8]
        xx, xy, yy = 0.5 * (p * a + q * b), 0.5 * (p * b + q * c), 0.5 * (r * b + s * c)
        scales = np.exp(log_scales[i].astype(np.float64))
        for k in range(3):
            mine[_SCALE + k] = 2.0 * _product(seen, k, k, xx, xy, yy)
            m, n = (k + 1) % 3, (k + 2) % 3
            ratio = scales[m] / scales[n] - scales[n] / scales[m]
            mine[_TURN + k] = 2.0 * _product(seen, m, n, xx, xy, yy) * ratio


@device
def _product(seen: F64, m: int, n: int, xx: float, xy: float, yy: float) -> float:
    """Axis m of a splat, times a symmetric matrix, times axis n."""
    product: float = seen[0, m] * (xx * seen[0, n] + xy * seen[1, n]) + seen[1, m] * (xy * seen[0, n] + yy * seen[1, n])
    return product


def gradients(drawable: Drawable, camera: Camera, target: F32) -> tuple[float, Gradients]:
    """The squared difference of a scene's picture to another one, and half its derivatives.

    Args:
        drawable: the N Gaussians.
        camera: where from.
        target: (height, width, 3) float32, what the picture should be, over black.

    Returns:
        The sum over pixels and channels of the squared difference; d(sum / 2).

    Raises:
        InvalidInput: ``input-shape``, `target` is not of the camera's size.
    """
    if target.shape != (camera.height, camera.width, 3):
        expected = (camera.height, camera.width, 3)
        raise InvalidInput("input-shape", f"expected a {expected} picture, got {target.shape}", field="target")
    columns, rows = -(-camera.width // TILE), -(-camera.height // TILE)
    splats, depths, index = project(drawable, camera)
    offsets, members = bin_splats(splats, depths, columns, rows)
    sums, errors = np.empty((len(members), _SUMS)), np.empty(columns * rows)
    wanted = np.ascontiguousarray(target, dtype=np.float32)
    _sum_tiles(splats, depths, offsets, members, spread(columns * rows), columns, wanted, sums, errors)
    total = _added(sums, members, len(splats))
    shown = np.flatnonzero((total != 0).any(axis=1))
    pose = np.ascontiguousarray(camera.world_to_camera, dtype=np.float64)
    lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height], dtype=np.float64)
    found = np.empty((len(shown), _COLUMNS))
    scene = drawable.scene
    _to_gaussians(
        index[shown],
        splats[shown],
        total[shown],
        scene.positions,
        drawable.shapes,
        scene.log_scales,
        pose,
        lens,
        found,
    )
    parts = np.split(found, (_OPACITY, _SCALE, _TURN, _PLACE), axis=1)
    colour, logit, log_scale, turn, position = (np.ascontiguousarray(part) for part in parts)
    return float(errors.sum()), Gradients(index[shown].astype(np.int64), colour, logit[:, 0], log_scale, turn, position)

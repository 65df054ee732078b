"""Splats blended over tiles, and the gradient of that, in Triton: what composite_tiles.h does, for CUDA.

One program a tile, its 256 pixels a vector, a loop over its splats. Every number has one writer, so results are the
same bits every time. `TRITON_INTERPRET=1`, set before this module is imported, runs it on the CPU, for tests.
"""

from __future__ import annotations

import triton
import triton.language as tl

HALF_LOG2_E: tl.constexpr = tl.constexpr(0.72134752)
"""Half a square in natural exponents, as an exponent of two."""


@triton.jit  # type: ignore[untyped-decorator]
def _splat(splats: tl.tensor, owners: tl.tensor, k: tl.tensor, columns: tl.tensor, rows: tl.tensor) -> tl.tuple:
    """Columns from the ridge, rows from the mean and alpha before the cap, at the pixels, of listed splat `k`."""
    base = splats + tl.load(owners + k) * 12
    dy = rows - tl.load(base + 1)
    u = columns - tl.load(base) - tl.load(base + 3) * dy
    exponent = HALF_LOG2_E * (tl.load(base + 2) * u * u + tl.load(base + 4) * dy * dy)
    return u, dy, tl.exp2(tl.load(base + 8) - exponent), base


@triton.jit  # type: ignore[untyped-decorator]
def _shade(
    raw: tl.tensor,
    left: tl.tensor,
    opened: tl.tensor,
    max_alpha: tl.tensor,
    min_alpha: tl.tensor,
    least: tl.tensor,
) -> tl.tuple:
    """Alpha, weight, and the transmittance left and openness of pixels that a splat is blended over."""
    alpha = tl.minimum(raw, max_alpha)
    alpha = tl.where(alpha >= min_alpha, alpha, 0.0)
    weight = alpha * left
    after = left - weight
    still = opened & (after >= least)
    return alpha, tl.where(still, weight, 0.0), tl.where(still, after, left), still


@triton.jit  # type: ignore[untyped-decorator]
def _pixels(
    tile: tl.tensor, width: tl.tensor, height: tl.tensor, tiles_across: tl.tensor, TILE: tl.constexpr
) -> tl.tuple:
    """Columns, rows, whether they are in the picture, and their places in it, of the pixels of a tile."""
    inside = tl.arange(0, TILE * TILE)
    column = (tile % tiles_across) * TILE + inside % TILE
    row = (tile // tiles_across) * TILE + inside // TILE
    return column, row, (column < width) & (row < height), row * width + column


@triton.jit  # type: ignore[untyped-decorator]
def blend(
    splats: tl.tensor,
    offsets: tl.tensor,
    listed: tl.tensor,
    owners: tl.tensor,
    background: tl.tensor,
    image: tl.tensor,
    transmittance: tl.tensor,
    weights: tl.tensor,
    drawn: tl.tensor,
    width: tl.tensor,
    height: tl.tensor,
    tiles_across: tl.tensor,
    max_alpha: tl.tensor,
    min_alpha: tl.tensor,
    least: tl.tensor,
    TILE: tl.constexpr,
) -> None:
    """Fill picture, transmittance, and weights (of those drawn) and count of the splats drawn of one tile."""
    tile = tl.program_id(0)
    column, row, shown, pixel = _pixels(tile, width, height, tiles_across, TILE)
    columns, rows = column + 0.5, row + 0.5
    left = tl.full([TILE * TILE], 1.0, tl.float32)
    red, green, blue = left * 0, left * 0, left * 0
    opened = shown
    first, past = tl.load(offsets + tile), tl.load(offsets + tile + 1)
    k = first
    while (k < past) & (tl.max(opened.to(tl.int32), 0) > 0):
        _u, _dy, raw, base = _splat(splats, owners, k, columns, rows)
        _alpha, weight, left, opened = _shade(raw, left, opened, max_alpha, min_alpha, least)
        red += weight * tl.load(base + 9)
        green += weight * tl.load(base + 10)
        blue += weight * tl.load(base + 11)
        tl.store(weights + tl.load(listed + k), tl.sum(weight, 0))
        k += 1
    tl.store(drawn + tile, (k - first).to(tl.int32))
    tl.store(transmittance + pixel, left, mask=shown)
    tl.store(image + 3 * pixel, red + left * tl.load(background), mask=shown)
    tl.store(image + 3 * pixel + 1, green + left * tl.load(background + 1), mask=shown)
    tl.store(image + 3 * pixel + 2, blue + left * tl.load(background + 2), mask=shown)


@triton.jit  # type: ignore[untyped-decorator]
def unblend(
    splats: tl.tensor,
    offsets: tl.tensor,
    listed: tl.tensor,
    owners: tl.tensor,
    image: tl.tensor,
    towards: tl.tensor,
    drawn: tl.tensor,
    gradients: tl.tensor,
    width: tl.tensor,
    height: tl.tensor,
    tiles_across: tl.tensor,
    max_alpha: tl.tensor,
    min_alpha: tl.tensor,
    least: tl.tensor,
    TILE: tl.constexpr,
) -> None:
    """Fill the (intersections, 9) gradients of the splats drawn of one tile: composite_tiles.h says which."""
    tile = tl.program_id(0)
    column, row, shown, pixel = _pixels(tile, width, height, tiles_across, TILE)
    columns, rows = column + 0.5, row + 0.5
    to_red = tl.load(towards + 3 * pixel, mask=shown, other=0.0)
    to_green = tl.load(towards + 3 * pixel + 1, mask=shown, other=0.0)
    to_blue = tl.load(towards + 3 * pixel + 2, mask=shown, other=0.0)
    behind = to_red * tl.load(image + 3 * pixel, mask=shown, other=0.0)
    behind += to_green * tl.load(image + 3 * pixel + 1, mask=shown, other=0.0)
    behind += to_blue * tl.load(image + 3 * pixel + 2, mask=shown, other=0.0)
    left = tl.full([TILE * TILE], 1.0, tl.float32)
    opened = shown
    first = tl.load(offsets + tile)
    k = first
    past = first + tl.load(drawn + tile)
    while k < past:
        u, dy, raw, base = _splat(splats, owners, k, columns, rows)
        before = left
        alpha, weight, left, opened = _shade(raw, left, opened, max_alpha, min_alpha, least)
        own = to_red * tl.load(base + 9) + to_green * tl.load(base + 10) + to_blue * tl.load(base + 11)
        behind -= weight * own
        moves = (weight > 0.0) & (raw <= max_alpha)
        moved = tl.where(moves, (before * own - behind / (1.0 - alpha)) * alpha, 0.0)
        out = gradients + 9 * tl.load(listed + k).to(tl.int64)
        tl.store(out, tl.sum(weight * to_red, 0))
        tl.store(out + 1, tl.sum(weight * to_green, 0))
        tl.store(out + 2, tl.sum(weight * to_blue, 0))
        tl.store(out + 3, tl.sum(moved, 0))
        tl.store(out + 4, tl.sum(moved * u, 0))
        tl.store(out + 5, tl.sum(moved * u * dy, 0))
        tl.store(out + 6, tl.sum(moved * u * u, 0))
        tl.store(out + 7, tl.sum(moved * dy, 0))
        tl.store(out + 8, tl.sum(moved * dy * dy, 0))
        k += 1

"""How a picture changes with each Gaussian: the derivatives that fitting a scene to pictures follows.

The derivatives of :mod:`scarfmt.render.rasterise`'s image model, which training follows too. What stays as it is:
which pixels a splat reaches, the order of splats, the directions that colours are seen from, and how much fainter
antialiasing makes a splat. An alpha that is capped does not change with its splat, nor does a colour clamped at 0.
"""

from __future__ import annotations

from ctypes import byref, c_int64
from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import F32, I64
from scarfmt.errors import InvalidInput
from scarfmt.render.camera import Camera
from scarfmt.render.native.binding import BLEND, COLOUR, GRADIENTS, LOG_OPACITY, UNBLEND, Lens, Scene, load
from scarfmt.render.projection import Drawable, Projected, address, addresses, list_tiles, project
from scarfmt.render.rasterise import job_of


@dataclass(frozen=True)
class Gradients:
    """Derivatives of a loss by V Gaussians that a picture shows; by all others it is 0.

    Attributes:
        index: (V,) int64 rising, which Gaussians.
        colour: (V, 3) float32, by the colour the camera sees.
        logit: (V,) float32, by the opacity's logit.
        log_scale: (V, 3) float32.
        turn: (V, 3) float32, by small turns about the Gaussian's own axes, radians.
        position: (V, 3) float32, 1 / world units.
    """

    index: I64
    colour: F32
    logit: F32
    log_scale: F32
    turn: F32
    position: F32


@dataclass(frozen=True)
class _BySplats:
    """Derivatives by what S splats are made of, the ellipses in their order, the others in that of their Gaussians.

    Attributes:
        ellipses: (S, 3) float32 across, slope, down.
        means: (S, 2) float32 pixels.
        opacities: (S,) float32.
        colours: (S, 3) float32.
    """

    ellipses: F32
    means: F32
    opacities: F32
    colours: F32


def gradients(drawable: Drawable, camera: Camera, target: F32) -> tuple[float, Gradients]:
    """The squared difference of a scene's picture to another one, and half its derivatives.

    Args:
        drawable: the N Gaussians.
        target: (height, width, 3) float32, what the picture should be, over black.

    Returns:
        The sum over pixels and channels of the squared difference; d(sum / 2).

    Raises:
        InvalidInput: ``input-shape``, `target` is not of the camera's size; ``input-dependency`` where the compiled
            renderer is missing.
    """
    if target.shape != (camera.height, camera.width, 3):
        expected = (camera.height, camera.width, 3)
        raise InvalidInput("input-shape", f"expected a {expected} picture, got {target.shape}", field="target")
    seen = project(drawable, camera)
    error, by = _by_splats(seen, camera, target)
    splats = np.empty_like(seen.splats)
    splats[seen.order] = seen.splats
    by_ln_alpha = by.opacities * np.exp2(splats[:, LOG_OPACITY])
    position, log_scale, turn = _to_shapes(drawable, camera, seen, by)
    found = Gradients(
        seen.index.astype(np.int64),
        by.colours * (splats[:, COLOUR] > 0),
        by_ln_alpha * (1 - drawable.opacities[seen.index]),
        log_scale,
        turn,
        position,
    )
    shown = (by.colours != 0).any(axis=1) | (by.opacities != 0)
    return error, Gradients(*(values[shown] for values in vars(found).values()))


def _by_splats(seen: Projected, camera: Camera, target: F32) -> tuple[float, _BySplats]:
    """The squared difference of a picture to `target`, and half its derivatives by the splats."""
    library, count = load(), len(seen.splats)
    listing = list_tiles(seen.splats, camera, numbered=True)
    job, image = job_of(seen.splats, listing, camera), np.empty(target.shape, np.float32)
    left, drawn = np.empty(target.shape[:2], np.float32), np.empty(job.tiles, np.int32)
    job.image, job.transmittance, job.drawn = address(image), address(left), address(drawn)
    library.scar_composite(byref(job), BLEND, byref(c_int64(0)))
    towards, parts = image - target.astype(np.float32), np.empty((len(listing.owners), GRADIENTS), np.float32)
    job.towards, job.gradients = address(towards), address(parts)
    library.scar_composite(byref(job), UNBLEND, byref(c_int64(0)))
    by = _BySplats(*(np.empty(shape, np.float32) for shape in ((count, 3), (count, 2), count, (count, 3))))
    given = parts, listing.starts, seen.order.astype(np.int64), seen.splats
    library.scar_composite_gather(*addresses(*given), 0, count, *addresses(*vars(by).values()))
    return float(np.square(towards, dtype=np.float64).sum()), by


def _to_shapes(drawable: Drawable, camera: Camera, seen: Projected, by: _BySplats) -> tuple[F32, F32, F32]:
    """Derivatives by positions, logarithms of scales and turns of the Gaussians that are seen."""
    index, order = seen.index, seen.order.astype(np.int64)
    positions, scales = drawable.scene.positions[index], drawable.scales[index]
    rotations, opacities = drawable.scene.rotations[index], drawable.opacities[index]
    gaussians = Scene(*addresses(positions, scales, rotations, opacities))
    by_position, by_scale, by_rotation = (np.empty((len(index), width), np.float32) for width in (3, 3, 4))
    filled = by.means, by.ellipses, by_position, by_scale, by_rotation
    view = byref(gaussians), byref(Lens.of(camera))
    load().scar_project_back(*view, address(order), 0, len(index), *addresses(*filled))
    w, x, y, z = rotations.T
    # Half of what a turn about each axis adds to a quaternion.
    about = np.stack([[-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]])
    turn = 0.5 * (about * by_rotation.T).sum(axis=1).T
    return by_position, by_scale * scales, np.ascontiguousarray(turn)

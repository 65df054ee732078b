"""Tile rasteriser: pictures of Gaussian scenes, and what each Gaussian contributes to them.

The rules are INRIA's (3D Gaussian Splatting, appendix C): splats blended front to back, alpha capped at 0.99
and dropped below 1/255, a pixel closed before its transmittance would fall under 1e-4. All arithmetic is float32 in a
fixed order (:mod:`scarfmt.render.native`): the same bits on every machine, whatever the number of threads.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from ctypes import byref, c_float, c_int64
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, I64
from scarfmt.render.camera import Camera
from scarfmt.render.native.binding import BLEND, COLOUR, MEASURE, MEASURES, Job, load
from scarfmt.render.projection import Drawable, Listing, address, addresses, check_colours, list_tiles, project
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.threads import map_threads

_BLACK = (0.0, 0.0, 0.0)


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
        sh_degree: use spherical-harmonic bands up to this degree only; default all.
        colours: (N, 3) colours to use instead of the spherical harmonics (anchor models give these).

    Raises:
        InvalidInput: `colours` has the wrong shape; ``input-dependency`` where the compiled renderer is missing.
    """
    splats = project(scene, camera, sh_degree, colours).splats
    return _draw(splats, list_tiles(splats, camera, numbered=False), camera, background)


def render_with(scene: GaussianScene | Drawable, camera: Camera, colours: NDArray[np.floating]) -> tuple[F32, F32]:
    """Two pictures, as :func:`render` makes them: in the scene's colours, and in others.

    What is where is found once for both.

    Args:
        scene: the N Gaussians.
        colours: (N, 3) the other colours.

    Raises:
        InvalidInput: as :func:`render`.
    """
    drawable = Drawable.of(scene)
    others = check_colours(colours, len(drawable.scene))
    seen = project(drawable, camera)
    listing = list_tiles(seen.splats, camera, numbered=False)
    own = _draw(seen.splats, listing, camera, _BLACK)
    seen.splats[:, COLOUR] = others[seen.index[seen.order]]
    return own, _draw(seen.splats, listing, camera, _BLACK)


def _draw(splats: F32, listing: Listing, camera: Camera, background: Sequence[float]) -> F32:
    """The picture of splats that are in tiles, (height, width, 3)."""
    image = np.empty((camera.height, camera.width, 3), dtype=np.float32)
    job = job_of(splats, listing, camera)
    left, drawn = np.empty(image.shape[:2], np.float32), np.empty(job.tiles, np.int32)
    job.background = (c_float * 3)(*background)
    job.image, job.transmittance, job.drawn = address(image), address(left), address(drawn)
    load().scar_composite(byref(job), BLEND, byref(c_int64(0)))
    return image


def job_of(splats: F32, listing: Listing, camera: Camera) -> Job:
    """The arguments of compositing that any pass needs."""
    job = Job.of(camera)
    job.splats, job.offsets, job.owners = address(splats), address(listing.offsets), address(listing.owners)
    job.listed = address(listing.listed)
    return job


@dataclass(frozen=True)
class Contributions:
    """The contributions of V Gaussians to one picture; all other Gaussians contribute nothing.

    The weight of a Gaussian at a pixel is w = alpha * transmittance.

    Attributes:
        index: (V,) int64 rising, which Gaussians.
        weight_sq: (V,) float64, sum of w^2 over all pixels.
        weight_max: (V,) float64, largest w, 0..0.99.
        contrast_sq: (V,) float64, sum over pixels of w^2 |c - c_behind|^2 (summed over R, G, B), with c_behind
            the colour composited behind the Gaussian divided by the transmittance there: the square of
            alpha * d(pixel)/d(alpha), i.e. how much a relative error of alpha is seen.
    """

    index: I64
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
        InvalidInput: as :func:`render`.
    """
    drawable = Drawable.of(scene)

    def contribute(camera: Camera) -> Contributions:
        seen = project(drawable, camera, colours=colours)
        measures = _measure(seen.splats, list_tiles(seen.splats, camera, numbered=True), camera)
        sums = np.empty_like(measures)
        sums[seen.order] = measures
        shown = np.flatnonzero(sums[:, 2] > 0)
        weight_sq, contrast_sq, weight_max = sums[shown].T
        return Contributions(seen.index[shown].astype(np.int64), weight_sq, weight_max, contrast_sq)

    yield from map_threads(contribute, cameras)


def _measure(splats: F32, listing: Listing, camera: Camera) -> F64:
    """(S, 3) sums over the picture of w^2 and of w^2 |c - c_behind|^2 of each splat, and its largest w."""
    job, parts = job_of(splats, listing, camera), len(listing.owners)
    weights, drawn = np.empty(parts, np.float32), np.empty(job.tiles, np.int32)
    measures, sums = np.empty((parts, MEASURES), np.float32), np.empty((len(splats), MEASURES))
    job.weights, job.drawn, job.measures = address(weights), address(drawn), address(measures)
    library = load()
    library.scar_composite(byref(job), MEASURE, byref(c_int64(0)))
    given = weights, measures, listing.starts
    library.scar_composite_measures(*addresses(*given), len(splats), address(sums))
    return sums

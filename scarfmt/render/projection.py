"""From 3D Gaussians to the ellipses a camera sees: EWA projection, colour, order and tiles.

Zwicker et al. 2001, "EWA volume splatting", with the constants of INRIA's 3D Gaussian Splatting. Scenes that are marked
antialiased are drawn as Mip-Splatting does (SPEC §5.2); all others as classic ones, two-dimensional ones among them.
"""

from __future__ import annotations

from ctypes import byref
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, I32, I64, Floats
from scarfmt.container.registries import RenderModel
from scarfmt.errors import InvalidInput
from scarfmt.render.camera import Camera
from scarfmt.render.native.binding import MIN_ALPHA, SPLAT, TILE, Lens, Outlook, Scene, load
from scarfmt.scene.gaussians import GaussianScene

_ORIGIN_SAMPLES = 1000


@dataclass(frozen=True)
class Drawable:
    """A scene made ready to be drawn from many views: what does not depend on the camera is computed once.

    Attributes:
        scene: N Gaussians in contiguous arrays.
        scales: (N, 3) float32 standard deviations, world units.
        opacities: (N,) float32, 0..1.
        origin: (3,) float64 amid the scene, world units.
        outline: (5, N) float32 positions from there; variance of the longest axis, world units^2; and how far the
            ellipse reaches, deviations^2, negative where nothing can be seen: what looking for them in a picture goes
            through.
    """

    scene: GaussianScene
    scales: F32
    opacities: F32
    origin: F64
    outline: F32

    @staticmethod
    def of(scene: GaussianScene | Drawable) -> Drawable:
        """The projection's input for a scene. An input that is ready is returned as it is.

        Raises:
            InvalidInput: ``input-dependency`` where the compiled renderer is missing.
        """
        if isinstance(scene, Drawable):
            return scene
        ready = replace(
            scene,
            positions=np.ascontiguousarray(scene.positions, dtype=np.float64),
            log_scales=np.ascontiguousarray(scene.log_scales, dtype=np.float32),
            rotations=np.ascontiguousarray(scene.rotations, dtype=np.float32),
            opacity_logits=np.ascontiguousarray(scene.opacity_logits, dtype=np.float32),
            sh=np.ascontiguousarray(scene.sh, dtype=np.float32),
        )
        count = len(ready)
        scales, opacities = np.empty((count, 3), np.float32), np.empty(count, np.float32)
        outline, origin = np.empty((5, count), np.float32), _origin(ready.positions)
        given = ready.positions, ready.log_scales, ready.opacity_logits, origin
        made = scales, opacities, outline
        load().scar_prepare(*addresses(*given), count, MIN_ALPHA, *addresses(*made))
        return Drawable(ready, scales, opacities, origin, outline)

    def near_picture(self, camera: Camera) -> I32:
        """(V,) int32 rising: the Gaussians whose ellipses may touch a picture; some of them do not."""
        found = np.empty(len(self.scene), np.int32)
        outlook = Outlook.of(camera, self.origin)
        count = load().scar_nearby(byref(outlook), address(self.outline), len(found), address(found))
        return found[:count]


def _origin(positions: F64) -> F64:
    """A place amid the scene: differences from it keep more digits in float32."""
    some = positions[:: max(1, len(positions) // _ORIGIN_SAMPLES)]
    some = some[np.isfinite(some).all(axis=1)]
    return np.asarray(np.median(some, axis=0)) if len(some) else np.zeros(3)


def address(array: NDArray[Any]) -> int:
    """Where the numbers of an array in C order begin."""
    assert array.flags.c_contiguous
    return array.ctypes.data


def addresses(*arrays: NDArray[Any]) -> list[int]:
    """:func:`address` of each."""
    return [address(array) for array in arrays]


@dataclass(frozen=True)
class Projected:
    """S splats of a picture, nearest first; of two as near, the one whose Gaussian comes first.

    Attributes:
        splats: (S, 12) float32 rows as `Splat` of raster.h.
        index: (S,) int32 rising, which Gaussians show.
        order: (S,) int32 for each splat, the place of its Gaussian in `index`.
    """

    splats: F32
    index: I32
    order: I32


def project(
    scene: GaussianScene | Drawable,
    camera: Camera,
    sh_degree: int | None = None,
    colours: Floats | None = None,
) -> Projected:
    """The splats of a picture.

    Args:
        scene: the N Gaussians.
        sh_degree: use bands up to this degree only; default all.
        colours: (N, 3) colours to use instead of the spherical harmonics, unclamped.

    Raises:
        InvalidInput: `colours` has the wrong shape.
    """
    drawable = Drawable.of(scene)
    ready, library = drawable.scene, load()
    fixed = None if colours is None else check_colours(colours, len(ready))
    found = drawable.near_picture(camera)
    count = len(found)
    gaussians = Scene(
        *addresses(ready.positions, drawable.scales, ready.rotations, drawable.opacities),
        None if fixed is None else address(fixed),
        address(ready.sh),
        ready.sh.shape[1],
        ready.sh_degree if sh_degree is None else min(sh_degree, ready.sh_degree),
    )
    lens = Lens.of(camera, ready.description.render_model == RenderModel.ANTIALIASED)
    entries, unsorted = np.empty((2, count), np.uint64), np.empty((count, SPLAT), np.float32)
    splats, index, order = np.empty_like(unsorted), np.empty(count, np.int32), np.empty(count, np.int32)
    filled = *entries, unsorted, index, splats, order
    seen = library.scar_see(byref(gaussians), byref(lens), address(found), count, *addresses(*filled))
    return Projected(splats[:seen], index[:seen], order[:seen])


def check_colours(colours: Floats, count: int) -> F32:
    """Colours as the renderer takes them: (count, 3) float32 in C order.

    Raises:
        InvalidInput: they have another shape.
    """
    if colours.shape != (count, 3):
        raise InvalidInput("input-shape", f"expected ({count}, 3) colours, got {colours.shape}", field="colours")
    return np.ascontiguousarray(colours, dtype=np.float32)


@dataclass(frozen=True)
class Listing:
    """I intersections of splats and tiles: numbered splat by splat, tiles row by row; listed tile by tile.

    Attributes:
        offsets: (tiles + 1,) int64, where the list of a tile starts.
        owners: (I,) int32, the splats of those listed, of a tile in their order.
        listed: (I,) int32, the numbers of those listed; empty where they were not asked for.
        starts: (S + 1,) int64, the first number of each splat.
    """

    offsets: I64
    owners: I32
    listed: I32
    starts: I64


def list_tiles(splats: F32, camera: Camera, numbered: bool) -> Listing:
    """Which tiles of a picture each of (S, 12) splats may show in; `numbered` asks for numbers of intersections."""
    library, count = load(), len(splats)
    columns, rows = -(-camera.width // TILE), -(-camera.height // TILE)
    spans, starts = np.empty((count, 4), np.int32), np.empty(count + 1, np.int64)
    offsets = np.empty(columns * rows + 1, np.int64)
    size = count, camera.width, camera.height
    library.scar_count_tiles(address(splats), *size, address(spans), address(starts), address(offsets))
    owners, fill = np.empty(starts[-1], np.int32), offsets.copy()
    listed = np.empty(len(owners) if numbered else 0, np.int32)
    places = address(listed) if numbered else None
    library.scar_list_tiles(address(spans), count, columns, address(fill), places, address(owners))
    return Listing(offsets, owners, listed, starts)

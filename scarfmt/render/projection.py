"""From 3D Gaussians to the ellipses a camera sees: EWA projection, colour and bounds.

Zwicker et al. 2001, "EWA volume splatting", with the constants of INRIA's 3D Gaussian Splatting. Scenes that are marked
antialiased are drawn as Mip-Splatting does (SPEC §5.2); all others as classic ones, two-dimensional ones among them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numba import prange
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64
from scarfmt.container.registries import RenderModel
from scarfmt.render.camera import Camera
from scarfmt.render.jit import device, kernel
from scarfmt.scene.gaussians import GaussianScene

MIN_ALPHA = 1.0 / 255.0
MAX_ALPHA = 0.99
MIN_TRANSMITTANCE = 1e-4
FRUSTUM_MARGIN = 1.3
# The bounds of an ellipse are widened by this much of a pixel, so that rounding never drops a pixel.
_BOUND_SLACK = 1e-3
_POWER_SLACK = 1e-6
# Bounds are rounded to binary32 and away from what they bound.
_UP, _DOWN = 1 + 1e-6, 1 - 1e-6

# Columns of a splat row.
MEAN_X, MEAN_Y, CONIC_A, CONIC_B, CONIC_C, OPACITY, RED, GREEN, BLUE, HALF_X, HALF_Y, FAINTEST = range(12)
SPLAT_COLUMNS = 12
# Columns of a shape row, after nine of the axes.
_OPACITY, _REACH = 9, 10
_SHAPE_COLUMNS = 11
_BLOCK = 512

Place = tuple[float, float, float]
Turn = tuple[float, float, float, float, float, float, float, float, float]
"""The rotation of a pose by rows."""
Lens = tuple[float, float, float, float, float, float, float, float, float]
"""fx, fy, cx, cy, width, height, near, dilation, and 1 where what is widened is made fainter in return, else 0."""

_C0 = 0.28209479177387814
_C1 = 0.4886025119029199
_C2A, _C2B, _C2C = 1.0925484305920792, 0.31539156525252005, 0.5462742152960396
_C3A, _C3B, _C3C, _C3D, _C3E = (
    0.5900435899266435,
    2.890611442640554,
    0.4570457994644658,
    0.3731763325901154,
    1.445305721320277,
)


@device
def _sh_basis(x: float, y: float, z: float, degree: int, basis: F64) -> None:
    """Fill `basis` (16,) with the real spherical harmonics of the unit direction, INRIA's order and signs."""
    basis[0] = _C0
    if degree > 0:
        basis[1] = -_C1 * y
        basis[2] = _C1 * z
        basis[3] = -_C1 * x
    if degree > 1:
        basis[4] = _C2A * x * y
        basis[5] = -_C2A * y * z
        basis[6] = _C2B * (2.0 * z * z - x * x - y * y)
        basis[7] = -_C2A * x * z
        basis[8] = _C2C * (x * x - y * y)
    if degree > 2:
        basis[9] = -_C3A * y * (3.0 * x * x - y * y)
        basis[10] = _C3B * x * y * z
        basis[11] = -_C3C * y * (4.0 * z * z - x * x - y * y)
        basis[12] = _C3D * z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y)
        basis[13] = -_C3C * x * (4.0 * z * z - x * x - y * y)
        basis[14] = _C3E * z * (x * x - y * y)
        basis[15] = -_C3A * x * (x * x - 3.0 * y * y)


@device
def _axes(rotation: F32, log_scale: F32, shape: F64) -> None:
    """Fill the start of `shape` with the rows of R diag(exp(log_scale)); a zero quaternion stands for no rotation."""
    # numba's float() would leave these float32.
    w, x, y, z = np.float64(rotation[0]), np.float64(rotation[1]), np.float64(rotation[2]), np.float64(rotation[3])
    largest = max(max(abs(w), abs(x)), max(abs(y), abs(z)))
    if largest > 0.0:
        w, x, y, z = w / largest, x / largest, y / largest, z / largest
        length = math.sqrt(w * w + x * x + y * y + z * z)
        w, x, y, z = w / length, x / length, y / length, z / length
    else:
        w = np.float64(1.0)
    s0, s1, s2 = np.exp(np.float64(log_scale[0])), np.exp(np.float64(log_scale[1])), np.exp(np.float64(log_scale[2]))
    shape[0] = (1.0 - 2.0 * (y * y + z * z)) * s0
    shape[1] = 2.0 * (x * y - w * z) * s1
    shape[2] = 2.0 * (x * z + w * y) * s2
    shape[3] = 2.0 * (x * y + w * z) * s0
    shape[4] = (1.0 - 2.0 * (x * x + z * z)) * s1
    shape[5] = 2.0 * (y * z - w * x) * s2
    shape[6] = 2.0 * (x * z - w * y) * s0
    shape[7] = 2.0 * (y * z + w * x) * s1
    shape[8] = (1.0 - 2.0 * (x * x + y * y)) * s2


@device
def _touches(mean: float, half: float, size: float) -> bool:
    """Whether the centre of some pixel of the picture lies within `half` of `mean`, pixels."""
    first, last = max(0.0, np.ceil(mean - half - 0.5)), min(size - 1.0, np.floor(mean + half - 0.5))
    return bool(first <= last)


@device
def _ellipse(place: Place, shapes: F64, i: int, turn: Turn, lens: Lens, splats: F64, row: int) -> bool:
    """Fill centre, conic and half extents of a splat with shape `i`; False where nothing can be seen.

    Arrays are passed whole with a row: a view of a row costs as much as the arithmetic.
    """
    x, y, z = place
    fx, fy, cx, cy, width, height, _, dilation, antialiased = lens
    t00, t01, t02, t10, t11, t12, t20, t21, t22 = turn
    limit_x, limit_y = FRUSTUM_MARGIN * width / (2.0 * fx), FRUSTUM_MARGIN * height / (2.0 * fy)
    tx = min(limit_x, max(-limit_x, x / z))
    ty = min(limit_y, max(-limit_y, y / z))
    scale_x, scale_y = fx / z, fy / z
    j0, j1, j2 = scale_x * (t00 - tx * t20), scale_x * (t01 - tx * t21), scale_x * (t02 - tx * t22)
    k0, k1, k2 = scale_y * (t10 - ty * t20), scale_y * (t11 - ty * t21), scale_y * (t12 - ty * t22)
    a0 = j0 * shapes[i, 0] + j1 * shapes[i, 3] + j2 * shapes[i, 6]
    a1 = j0 * shapes[i, 1] + j1 * shapes[i, 4] + j2 * shapes[i, 7]
    a2 = j0 * shapes[i, 2] + j1 * shapes[i, 5] + j2 * shapes[i, 8]
    b0 = k0 * shapes[i, 0] + k1 * shapes[i, 3] + k2 * shapes[i, 6]
    b1 = k0 * shapes[i, 1] + k1 * shapes[i, 4] + k2 * shapes[i, 7]
    b2 = k0 * shapes[i, 2] + k1 * shapes[i, 5] + k2 * shapes[i, 8]
    cov_xx, cov_xy, cov_yy = a0 * a0 + a1 * a1 + a2 * a2, a0 * b0 + a1 * b1 + a2 * b2, b0 * b0 + b1 * b1 + b2 * b2
    # |a x b|^2 is the undilated determinant (Cauchy-Binet), free of the cancellation of xx * yy - xy^2.
    n0, n1, n2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    undilated = n0 * n0 + n1 * n1 + n2 * n2
    determinant = undilated + dilation * (cov_xx + cov_yy) + dilation * dilation
    cov_xx += dilation
    cov_yy += dilation
    if not (determinant < np.inf):
        return False
    mean_x, mean_y, opacity, reach = fx * x / z + cx, fy * y / z + cy, shapes[i, _OPACITY], shapes[i, _REACH]
    if antialiased > 0.0:  # Mip-Splatting (Yu et al. 2024), equation 10
        opacity *= math.sqrt(undilated / determinant)
        if not (opacity >= MIN_ALPHA):
            return False
        reach = 2.0 * math.log(opacity / MIN_ALPHA)
    half_x, half_y = math.sqrt(reach * cov_xx) + _BOUND_SLACK, math.sqrt(reach * cov_yy) + _BOUND_SLACK
    if not (_touches(mean_x, half_x, width) and _touches(mean_y, half_y, height)):
        return False
    splats[row, MEAN_X], splats[row, MEAN_Y] = mean_x, mean_y
    splats[row, CONIC_A], splats[row, CONIC_C] = cov_yy / determinant, cov_xx / determinant
    splats[row, CONIC_B] = -cov_xy / determinant
    splats[row, OPACITY] = opacity
    splats[row, HALF_X], splats[row, HALF_Y] = half_x, half_y
    # Rounding must not drop what the rules keep: they compare alphas.
    splats[row, FAINTEST] = -0.5 * reach - _POWER_SLACK
    return True


@device
def _colour(direction: Place, sh: F32, i: int, degree: int, basis: F64, splats: F64, row: int) -> None:
    """Fill the colour of a splat from spherical harmonics `i` and the unnormalised view direction."""
    x, y, z = direction
    length = math.sqrt(x * x + y * y + z * z)
    _sh_basis(x / length, y / length, z / length, degree, basis)
    red, green, blue = 0.5, 0.5, 0.5
    for k in range((degree + 1) * (degree + 1)):
        red += basis[k] * sh[i, k, 0]
        green += basis[k] * sh[i, k, 1]
        blue += basis[k] * sh[i, k, 2]
    splats[row, RED], splats[row, GREEN], splats[row, BLUE] = max(0.0, red), max(0.0, green), max(0.0, blue)


@kernel
def _find_shapes(log_scales: F32, rotations: F32, logits: F32, shapes: F64, bounds: F32) -> None:
    """Fill the shapes (N, 11) and bounds (N, 2) of a :class:`Drawable`."""
    for i in prange(len(logits)):
        opacity = 1.0 / (1.0 + np.exp(-np.float64(logits[i])))
        largest = max(max(log_scales[i, 0], log_scales[i, 1]), log_scales[i, 2])
        # Written so that a NaN counts as unseen.
        reach = 2.0 * math.log(opacity / MIN_ALPHA) if opacity >= MIN_ALPHA else -1.0
        bounds[i, 0], bounds[i, 1] = _UP * np.exp(2.0 * np.float64(largest)), _UP * reach
        _axes(rotations[i], log_scales[i], shapes[i])
        shapes[i, _OPACITY], shapes[i, _REACH] = opacity, reach


@device
def _misses(centre: float, slope: float, focal: float, size: float, variance: float, reach: float, blur: float) -> bool:
    """Whether no ellipse of a Gaussian can touch the centre of a pixel along one axis.

    Args:
        centre: of the Gaussian, pixels from the picture's first edge.
        slope: of the ray to it, clamped as for the projection.
        focal: pixels a world unit at its depth.
        size: of the picture, pixels.
        variance, reach: its bounds.
        blur: of the camera, pixels^2.
    """
    # How far the next centre of a pixel of the picture is: samples of a sparse picture lie between most splats.
    nearest = min(max(np.floor(centre), 0.0), size - 1.0) + 0.5
    beyond = abs(centre - nearest) - 2 * _BOUND_SLACK
    return bool(beyond > 0.0 and beyond * beyond > reach * (focal * focal * (1.0 + slope * slope) * variance + blur))


@kernel
def _near_picture(
    positions: F64, bounds: F32, pose: F64, lens: F64, found: NDArray[np.int32], counts: NDArray[np.int64]
) -> None:
    """Fill `found`, from the start of each block, with its Gaussians that may touch the picture, and `counts`."""
    fx, fy, cx, cy, width, height, near, blur, _ = lens
    limit_x, limit_y = FRUSTUM_MARGIN * width / (2.0 * fx), FRUSTUM_MARGIN * height / (2.0 * fy)
    for block in prange(len(counts)):
        fill = block * _BLOCK
        for i in range(block * _BLOCK, min(len(positions), (block + 1) * _BLOCK)):
            p0, p1, p2 = positions[i, 0], positions[i, 1], positions[i, 2]
            z = pose[2, 0] * p0 + pose[2, 1] * p1 + pose[2, 2] * p2 + pose[2, 3]
            # Written so that a NaN is left out too.
            if not (z > near * _DOWN and z < np.inf and bounds[i, 1] >= 0.0):
                continue
            x = (pose[0, 0] * p0 + pose[0, 1] * p1 + pose[0, 2] * p2 + pose[0, 3]) / z
            y = (pose[1, 0] * p0 + pose[1, 1] * p1 + pose[1, 2] * p2 + pose[1, 3]) / z
            variance, reach = np.float64(bounds[i, 0]), np.float64(bounds[i, 1])
            slope_x, slope_y = min(limit_x, max(-limit_x, x)), min(limit_y, max(-limit_y, y))
            if _misses(fx * x + cx, slope_x, fx / z, width, variance, reach, blur) or _misses(
                fy * y + cy, slope_y, fy / z, height, variance, reach, blur
            ):
                continue
            found[fill] = i
            fill += 1
        counts[block] = fill - block * _BLOCK


@device
def _joined(found: NDArray[np.int32], counts: NDArray[np.int64]) -> NDArray[np.int32]:
    """The values at the start of each block of `found`, one after another."""
    joined = np.empty(counts.sum(), np.int32)
    fill = 0
    for block in range(len(counts)):
        for k in range(counts[block]):
            joined[fill] = found[block * _BLOCK + k]
            fill += 1
    return joined


@kernel
def _project(
    drawn: NDArray[np.int32],
    positions: F64,
    shapes: F64,
    sh: F32,
    colours: F64,
    degree: int,
    pose: F64,
    eye: F64,
    lens: F64,
    splats: F64,
    depths: F32,
) -> None:
    """Fill `splats` and `depths` (inf where culled); work goes by blocks, so that scratch is allocated per block."""
    count = len(drawn)
    lenses = lens[0], lens[1], lens[2], lens[3], lens[4], lens[5], lens[6], lens[7], lens[8]
    turn = (
        pose[0, 0], pose[0, 1], pose[0, 2], pose[1, 0], pose[1, 1], pose[1, 2], pose[2, 0], pose[2, 1], pose[2, 2]
    )  # fmt: skip
    for block in prange((count + _BLOCK - 1) // _BLOCK):
        basis = np.empty(16)
        for row in range(block * _BLOCK, min(count, (block + 1) * _BLOCK)):
            i = drawn[row]
            depths[row] = np.inf
            p0, p1, p2 = positions[i, 0], positions[i, 1], positions[i, 2]
            x = pose[0, 3] + pose[0, 0] * p0 + pose[0, 1] * p1 + pose[0, 2] * p2
            y = pose[1, 3] + pose[1, 0] * p0 + pose[1, 1] * p1 + pose[1, 2] * p2
            z = pose[2, 3] + pose[2, 0] * p0 + pose[2, 1] * p1 + pose[2, 2] * p2
            # Written so that a NaN is culled too.
            if not (z > lens[6] and z < np.inf and shapes[i, _REACH] >= 0.0):
                continue
            if not _ellipse((x, y, z), shapes, i, turn, lenses, splats, row):
                continue
            depths[row] = z
            if len(colours) > 0:
                splats[row, RED], splats[row, GREEN], splats[row, BLUE] = colours[i, 0], colours[i, 1], colours[i, 2]
            else:
                _colour((p0 - eye[0], p1 - eye[1], p2 - eye[2]), sh, i, degree, basis, splats, row)


@dataclass(frozen=True)
class Drawable:
    """A scene made ready to be drawn from many views: what does not depend on the camera is computed once.

    Attributes:
        scene: N Gaussians in contiguous arrays.
        shapes: (N, 11) float64 axes by rows, world units; opacity; how far the ellipse reaches, deviations^2, negative
            where nothing can be seen.
        bounds: (N, 2) float32 variance of the longest axis, world units^2, and how far the ellipse reaches,
            deviations^2, both rounded up: what looking for them in a picture goes through.
    """

    scene: GaussianScene
    shapes: F64
    bounds: F32

    @staticmethod
    def of(scene: GaussianScene | Drawable) -> Drawable:
        """The projection's input for a scene. An input that is ready is returned as it is."""
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
        shapes, bounds = np.empty((len(ready), _SHAPE_COLUMNS)), np.empty((len(ready), 2), dtype=np.float32)
        _find_shapes(ready.log_scales, ready.rotations, ready.opacity_logits, shapes, bounds)
        return Drawable(ready, shapes, bounds)

    def near_picture(self, pose: F64, lens: F64) -> NDArray[np.int32]:
        """(V,) int32 rising: the Gaussians whose ellipses may touch the picture; some of them do not."""
        blocks = -(-len(self.scene) // _BLOCK)
        found, counts = np.empty(len(self.scene), np.int32), np.empty(blocks, np.int64)
        _near_picture(self.scene.positions, self.bounds, pose, lens, found, counts)
        return _joined(found, counts)


def project(
    scene: GaussianScene | Drawable, camera: Camera, sh_degree: int | None = None, colours: F64 | None = None
) -> tuple[F64, F32, NDArray[np.int32]]:
    """The splats of a picture, and how far away they are.

    Args:
        scene: the N Gaussians.
        camera: where from.
        sh_degree: use bands up to this degree only; default all.
        colours: (N, 3) float64 colours to use instead of the spherical harmonics, unclamped.

    Returns:
        (V, 12) float64 splats (columns `MEAN_X` .. `FAINTEST`; pixels, 1/pixels^2, colour units and the exponent
        below which nothing shows); (V,) float32
        depths, infinite where nothing of a splat touches a pixel's centre; and (V,) int32 rising, which Gaussian each
        splat is.
    """
    drawable = Drawable.of(scene)
    ready = drawable.scene
    degree = ready.sh_degree if sh_degree is None else min(sh_degree, ready.sh_degree)
    size = camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height
    antialiased = ready.description.render_model == RenderModel.ANTIALIASED
    lens = np.array([*size, camera.near, camera.dilation, antialiased], dtype=np.float64)
    pose = np.ascontiguousarray(camera.world_to_camera, dtype=np.float64)
    drawn = drawable.near_picture(pose, lens)
    splats, depths = np.empty((len(drawn), SPLAT_COLUMNS)), np.empty(len(drawn), dtype=np.float32)
    _project(
        drawn,
        ready.positions,
        drawable.shapes,
        ready.sh,
        np.zeros((0, 3)) if colours is None else np.ascontiguousarray(colours, dtype=np.float64),
        degree,
        pose,
        camera.centre,
        lens,
        splats,
        depths,
    )
    # Depth is compared as float32, as INRIA's sort keys do.
    return splats, depths, drawn

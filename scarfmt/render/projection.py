"""From 3D Gaussians to the ellipses a camera sees: EWA projection, colour and bounds.

Zwicker et al. 2001, "EWA volume splatting", with the constants of INRIA's 3D Gaussian Splatting.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64
from scarfmt.render.camera import Camera
from scarfmt.render.jit import device, kernel
from scarfmt.scene.gaussians import GaussianScene

MIN_ALPHA = 1.0 / 255.0
MAX_ALPHA = 0.99
MIN_TRANSMITTANCE = 1e-4
FRUSTUM_MARGIN = 1.3
# The bounds of an ellipse are widened by this much of a pixel, so that rounding never drops a pixel.
_BOUND_SLACK = 1e-3

# Columns of a splat row.
MEAN_X, MEAN_Y, CONIC_A, CONIC_B, CONIC_C, OPACITY, RED, GREEN, BLUE, HALF_X, HALF_Y = range(11)
SPLAT_COLUMNS = 11
_BLOCK = 512
_DIGIT_BITS = 11
_DIGIT_MASK = np.uint32((1 << _DIGIT_BITS) - 1)

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
def _axes(rotation: F32, log_scale: F32, axes: F64) -> None:
    """Fill `axes` (3, 3) with R diag(exp(log_scale)); a zero quaternion stands for no rotation."""
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
    axes[0, 0] = (1.0 - 2.0 * (y * y + z * z)) * s0
    axes[0, 1] = 2.0 * (x * y - w * z) * s1
    axes[0, 2] = 2.0 * (x * z + w * y) * s2
    axes[1, 0] = 2.0 * (x * y + w * z) * s0
    axes[1, 1] = (1.0 - 2.0 * (x * x + z * z)) * s1
    axes[1, 2] = 2.0 * (y * z - w * x) * s2
    axes[2, 0] = 2.0 * (x * z - w * y) * s0
    axes[2, 1] = 2.0 * (y * z + w * x) * s1
    axes[2, 2] = (1.0 - 2.0 * (x * x + y * y)) * s2


@device
def _ellipse(x: float, y: float, z: float, axes: F64, pose: F64, lens: F64, splat: F64) -> bool:
    """Fill centre, conic and half extents of a splat whose opacity is set; False where nothing can be seen."""
    fx, fy, cx, cy, width, height, dilation = lens[0], lens[1], lens[2], lens[3], lens[4], lens[5], lens[7]
    limit_x, limit_y = FRUSTUM_MARGIN * width / (2.0 * fx), FRUSTUM_MARGIN * height / (2.0 * fy)
    tx = min(limit_x, max(-limit_x, x / z))
    ty = min(limit_y, max(-limit_y, y / z))
    a0, a1, a2, b0, b1, b2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        jx = fx / z * (pose[0, k] - tx * pose[2, k])
        jy = fy / z * (pose[1, k] - ty * pose[2, k])
        a0, a1, a2 = a0 + jx * axes[k, 0], a1 + jx * axes[k, 1], a2 + jx * axes[k, 2]
        b0, b1, b2 = b0 + jy * axes[k, 0], b1 + jy * axes[k, 1], b2 + jy * axes[k, 2]
    cov_xx, cov_xy, cov_yy = a0 * a0 + a1 * a1 + a2 * a2, a0 * b0 + a1 * b1 + a2 * b2, b0 * b0 + b1 * b1 + b2 * b2
    # |a x b|^2 is the undilated determinant (Cauchy-Binet), free of the cancellation of xx * yy - xy^2.
    n0, n1, n2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    determinant = n0 * n0 + n1 * n1 + n2 * n2 + dilation * (cov_xx + cov_yy) + dilation * dilation
    cov_xx += dilation
    cov_yy += dilation
    if not (determinant < np.inf):
        return False
    splat[MEAN_X], splat[MEAN_Y] = fx * x / z + cx, fy * y / z + cy
    splat[CONIC_A], splat[CONIC_B], splat[CONIC_C] = cov_yy / determinant, -cov_xy / determinant, cov_xx / determinant
    reach = 2.0 * math.log(splat[OPACITY] / MIN_ALPHA)
    splat[HALF_X], splat[HALF_Y] = math.sqrt(reach * cov_xx) + _BOUND_SLACK, math.sqrt(reach * cov_yy) + _BOUND_SLACK
    return bool(
        splat[MEAN_X] + splat[HALF_X] > 0.0
        and splat[MEAN_X] - splat[HALF_X] < width
        and splat[MEAN_Y] + splat[HALF_Y] > 0.0
        and splat[MEAN_Y] - splat[HALF_Y] < height
    )


@device
def _colour(direction: F64, sh: F32, degree: int, basis: F64, splat: F64) -> None:
    """Fill the colour of a splat from its spherical harmonics and the unnormalised view direction (3,)."""
    x, y, z = direction[0], direction[1], direction[2]
    length = math.sqrt(x * x + y * y + z * z)
    _sh_basis(x / length, y / length, z / length, degree, basis)
    for channel in range(3):
        value = 0.5
        for k in range((degree + 1) * (degree + 1)):
            value += basis[k] * sh[k, channel]
        splat[RED + channel] = max(0.0, value)


@kernel
def _project(
    positions: F64,
    log_scales: F32,
    rotations: F32,
    logits: F32,
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
    count = len(positions)
    for block in prange((count + _BLOCK - 1) // _BLOCK):
        axes, basis, local = np.empty((3, 3)), np.empty(16), np.empty(3)
        for i in range(block * _BLOCK, min(count, (block + 1) * _BLOCK)):
            depths[i] = np.inf
            opacity = 1.0 / (1.0 + np.exp(-np.float64(logits[i])))
            for k in range(3):
                local[k] = pose[k, 3]
                for axis in range(3):
                    local[k] += pose[k, axis] * positions[i, axis]
            # Written so that a NaN is culled too.
            if not (local[2] > lens[6] and local[2] < np.inf and opacity >= MIN_ALPHA):
                continue
            _axes(rotations[i], log_scales[i], axes)
            splats[i, OPACITY] = opacity
            if not _ellipse(local[0], local[1], local[2], axes, pose, lens, splats[i]):
                continue
            depths[i] = local[2]
            if len(colours) > 0:
                splats[i, RED : BLUE + 1] = colours[i]
            else:
                for axis in range(3):
                    local[axis] = positions[i, axis] - eye[axis]
                _colour(local, sh[i], degree, basis, splats[i])


@device
def _nearest_first(depths: F32) -> NDArray[np.int64]:
    """Indices of the finite entries of `depths` (N,) in increasing order, ties by index.

    A radix sort of the bits, which for positive floats order like their values; three times as fast as
    numpy's stable sort, which is otherwise a third of the time of a picture.
    """
    count = 0
    for i in range(len(depths)):
        count += depths[i] < np.inf
    order, spare = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    keys = depths.view(np.uint32)
    fill = 0
    for i in range(len(depths)):
        if depths[i] < np.inf:
            order[fill] = i
            fill += 1
    for digit in range(3):
        shift = np.uint32(digit * _DIGIT_BITS)
        starts = np.zeros((1 << _DIGIT_BITS) + 1, dtype=np.int64)
        for i in range(count):
            starts[((keys[order[i]] >> shift) & _DIGIT_MASK) + 1] += 1
        for value in range(1 << _DIGIT_BITS):
            starts[value + 1] += starts[value]
        for i in range(count):
            value = (keys[order[i]] >> shift) & _DIGIT_MASK
            spare[starts[value]] = order[i]
            starts[value] += 1
        order, spare = spare, order
    return order


def project(
    scene: GaussianScene, camera: Camera, sh_degree: int | None = None, colours: F64 | None = None
) -> tuple[F64, NDArray[np.int64]]:
    """The splats a camera can see, nearest first.

    Args:
        scene: the N Gaussians.
        camera: where from.
        sh_degree: use bands up to this degree only; default all.
        colours: (N, 3) float64 colours to use instead of the spherical harmonics, unclamped.

    Returns:
        (V, 11) float64 splats (columns `MEAN_X` .. `HALF_Y`; pixels, 1/pixels^2 and colour units) in depth
        order with ties by index, and (V,) int64 rows of `scene` they come from.
    """
    degree = scene.sh_degree if sh_degree is None else min(sh_degree, scene.sh_degree)
    splats = np.empty((len(scene), SPLAT_COLUMNS))
    depths = np.empty(len(scene), dtype=np.float32)
    lens = np.array(
        [camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height, camera.near, camera.dilation],
        dtype=np.float64,
    )
    fixed = np.zeros((0, 3)) if colours is None else np.ascontiguousarray(colours, dtype=np.float64)
    pose = np.ascontiguousarray(camera.world_to_camera, dtype=np.float64)
    _project(
        np.ascontiguousarray(scene.positions, dtype=np.float64),
        np.ascontiguousarray(scene.log_scales, dtype=np.float32),
        np.ascontiguousarray(scene.rotations, dtype=np.float32),
        np.ascontiguousarray(scene.opacity_logits, dtype=np.float32),
        np.ascontiguousarray(scene.sh, dtype=np.float32),
        fixed,
        degree,
        pose,
        camera.centre,
        lens,
        splats,
        depths,
    )
    # Depth is compared as float32, as INRIA's sort keys do.
    order = _nearest_first(depths)
    return splats[order], order

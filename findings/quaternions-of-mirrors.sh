#!/usr/bin/env bash
# numpy-quaternion, quaternionic and transforms3d make a rotation of a mirrored camera, another one for every last digit.
#
# One would expect: a matrix of determinant -1, which no quaternion can hold, to be refused, as scipy, rowan and pytransform3d
#   do; or, since numpy-quaternion promises the closest one for matrices that are not quite rotations, a stable one.
# What happens: a length-1 quaternion comes back. All ways of turning the mirror back are equally near, so rounding chooses among
#   them: changes of 0.0000001 in the matrix turn the result by up to 180 degrees. Nothing is said.
# Packages: numpy-quaternion 2024.0.13, quaternionic 1.0.18, transforms3d 0.4.2, rowan 1.3.2, pytransform3d 3.17.0 and
#   scipy 1.17.1 (PyPI). Date: 2026-11-29.
# Why it matters: poses of Unity, Unreal and of a flipped axis are left-handed. Converted to COLMAP or to rotations of Gaussians by
#   these, each camera gets a turn of its own, which looks like bad poses. Check the determinant; turn two axes, or
#   mirror the whole scene.
# Output seen (largest angle between results for a mirrored camera with changes of 1e-7, in degrees; the same not mirrored):
#   numpy-quaternion 180, 0
#   quaternionic 180, 0
#   transforms3d 180, 0
#   rowan ValueError, 0
#   pytransform3d ValueError, 0
#   scipy ValueError, 0
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet numpy-quaternion==2024.0.13 quaternionic==1.0.18 transforms3d==0.4.2 rowan==1.3.2 \
  pytransform3d==3.17.0 scipy==1.17.1 numpy 2>pip.log
tools/bin/python -W ignore - <<'PY'
import sys

import numpy as np
import quaternion
import quaternionic
import rowan
from pytransform3d.rotations import quaternion_from_matrix
from scipy.spatial.transform import Rotation
from transforms3d.quaternions import mat2quat

MAKERS = {
    "numpy-quaternion": lambda matrix: quaternion.as_float_array(quaternion.from_rotation_matrix(matrix)),
    "quaternionic": lambda matrix: quaternionic.array.from_rotation_matrix(matrix).ndarray,
    "transforms3d": mat2quat,
    "rowan": rowan.from_matrix,
    "pytransform3d": quaternion_from_matrix,
    "scipy": lambda matrix: np.roll(Rotation.from_matrix(matrix).as_quat(), 1),
}
camera = Rotation.from_rotvec([0.3, -0.5, 1.9]).as_matrix()
changes = 1e-7 * np.random.default_rng(0).normal(size=(100, 3, 3))


def spread(make, matrix):
    try:
        made = np.array([make(matrix + change) for change in changes])
    except ValueError:
        return None
    return np.degrees(2 * np.arccos(np.clip(np.abs(made @ made.T), 0, 1))).max()


found = {}
for name, make in MAKERS.items():
    angles = [spread(make, camera @ np.diag([1.0, 1, -1])), spread(make, camera)]
    told = ["ValueError" if angle is None else f"{angle:.0f}" for angle in angles]
    print(name, ", ".join(told))
    found[name] = angles
stable = all(plain is not None and plain < 0.1 for _, plain in found.values())
loose = all(found[name][0] is not None and found[name][0] > 90 for name in list(MAKERS)[:3])
refused = all(found[name][0] is None for name in list(MAKERS)[3:])
sys.exit(not (stable and loose and refused))
PY

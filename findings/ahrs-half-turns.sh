#!/usr/bin/env bash
# Three of the five methods by which ahrs makes a quaternion of a matrix fail at half a turn; one finds no turn at all.
#
# One would expect: DCM(matrix).to_quaternion(method=...) to give the same rotation by each method, to rounding.
# What happens: signs of x, y, z come from differences across the diagonal, which are 0 at half a turn. Chiaverini's method takes
#   the sign of 0 for 0 and drops parts: diag(1, -1, -1) becomes the identity. Hughes' takes all signs for plus, or gives
#   NaN where rounding leaves a root below 0. Sarabandi's drops parts of an axis that is none of x, y, z. The result
#   has length 1. Shepperd's, which is the default, and Itzhack's are right; beside half a turn all are.
# Package: ahrs 0.4.0 (PyPI). Date: 2026-11-29.
# Why it matters: diag(1, -1, -1) is the step from OpenCV's camera to that of OpenGL, Blender and Nerfstudio, and of a scene with
#   y down to y up: the half turn is what converters of captures meet most. Take method="shepperd".
# Output seen (error of the matrix made of the quaternion, largest of its numbers):
#   chiaverini diag(1,-1,-1) 2.00, about 1,1,0 0.00, about 1,-2,3 0.43, 179 degrees about 1,-2,3 0.00
#   hughes     diag(1,-1,-1) 0.00, about 1,1,0 nan, about 1,-2,3 1.71, 179 degrees about 1,-2,3 0.00
#   itzhack    diag(1,-1,-1) 0.00, about 1,1,0 0.00, about 1,-2,3 0.00, 179 degrees about 1,-2,3 0.00
#   sarabandi  diag(1,-1,-1) 0.00, about 1,1,0 0.00, about 1,-2,3 0.43, 179 degrees about 1,-2,3 0.00
#   shepperd   diag(1,-1,-1) 0.00, about 1,1,0 0.00, about 1,-2,3 0.00, 179 degrees about 1,-2,3 0.00
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet ahrs==0.4.0 numpy scipy 2>pip.log
tools/bin/python -W ignore - <<'PY'
import sys

import numpy as np
from ahrs import DCM
from scipy.spatial.transform import Rotation


def turn(degrees, axis):
    return Rotation.from_rotvec(np.radians(degrees) * np.array(axis) / np.linalg.norm(axis)).as_matrix()


matrices = {
    "diag(1,-1,-1)": np.diag([1.0, -1, -1]),
    "about 1,1,0": turn(180, [1, 1, 0]),
    "about 1,-2,3": turn(180, [1, -2, 3]),
    "179 degrees about 1,-2,3": turn(179, [1, -2, 3]),
}
wrong = set()
for method in ("chiaverini", "hughes", "itzhack", "sarabandi", "shepperd"):
    told = []
    for title, matrix in matrices.items():
        quaternion = DCM(matrix).to_quaternion(method=method)
        error = np.nan
        if np.isfinite(quaternion).all():
            error = np.abs(Rotation.from_quat(np.roll(quaternion, -1)).as_matrix() - matrix).max()
        if not error < 0.01:
            wrong.add((method, title))
        told.append(f"{title} {error:.2f}")
    print(f"{method:10}", ", ".join(told))
expected = {("chiaverini", "diag(1,-1,-1)"), ("chiaverini", "about 1,-2,3"), ("sarabandi", "about 1,-2,3"), ("hughes", "about 1,-2,3")}
sys.exit(not (expected <= wrong <= expected | {("hughes", "about 1,1,0")}))
PY

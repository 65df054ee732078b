#!/usr/bin/env bash
# pycolmap takes a quaternion of any length for a rotation: its matrix stretches, and cameras move.
#
# One would expect: Rotation3d, and images.txt, to hold rotations: other quaternions are scaled to length 1, or refused.
# What happens: the numbers are kept as they are, and the matrix follows the formula for length 1. With 0.72 in place of
#   0.7071, the matrix has determinant 1.076, and a camera 3.7 units from zero is 0.16 units off. The inverse of such
#   a rotation does not undo it.
# Package: pycolmap 4.2.1 (PyPI). Date: 2026-11-28.
# Why it matters: files of other programs hold rounded quaternions, and networks put out some that are not of length 1.
#   INRIA's trainer, and renderers, scale Gaussians' quaternions, so one expects it of cameras too. Scale them before.
# Output seen:
#   length 1.0000: determinant 1.0000, centre 3.00 -2.00 -1.00, there and back 1.00 0.00 1.00
#   length 1.0182: determinant 1.0763, centre 2.86 -2.00 -1.07, there and back 1.07 0.00 0.93
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet pycolmap==4.2.1 numpy 2>pip.log
tools/bin/python - <<'PY'
import sys
from pathlib import Path

import numpy as np
import pycolmap

Path("cameras.txt").write_text("1 PINHOLE 640 480 500 500 320 240\n")
Path("points3D.txt").write_text("")
found = {}
for half in (0.5**0.5, 0.72):
    Path("images.txt").write_text(f"1 {half!r} 0 {half!r} 0 1 2 3 1 photo.jpg\n\n")
    (image,) = pycolmap.Reconstruction(".").images.values()
    rotation = image.cam_from_world().rotation
    determinant, centre = np.linalg.det(rotation.matrix()), image.projection_center()
    back = rotation.inverse() * (rotation * np.array([1.0, 0, 1]))
    print(
        f"length {half * 2**0.5:.4f}: determinant {determinant:.4f}, centre {' '.join(f'{x:.2f}' for x in centre)},"
        f" there and back {' '.join(f'{x:.2f}' for x in back)}"
    )
    found[half] = determinant, centre
right, wrong = found.values()
sys.exit(bool(abs(right[0] - 1) > 1e-9 or wrong[0] < 1.07 or np.linalg.norm(right[1] - wrong[1]) < 0.1))
PY

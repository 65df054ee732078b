#!/usr/bin/env bash
# usd-core reads an array of any shape as rows of three or four, as long as its numbers divide evenly.
#
# One would expect: Vt.Vec3fArray.FromNumpy, and Set of an attribute, to want arrays of n x 3, and to refuse 3 x n, or n x 4 with a
#   column of ones, as numbers that do not divide by 3 are refused.
# What happens: the numbers are taken row by row, whatever the shape: 3 x n gives n points of mixed axes, 6 points of n x 4 give 8
#   points. Four quaternions of 3 columns make three. Only a number that does not divide raises ValueError, so that 5
#   points of n x 4 do, and 6 do not.
# Package: usd-core 26.11 (PyPI). Date: 2026-11-29.
# Why it matters: libraries of points keep them axis by axis, too, and homogeneous points have four columns. Every attribute of a
#   Gaussian is written by such arrays. A file of as many points as expected comes out, with every one at another place.
# Output seen:
#   points, 6 x 3: 6 rows, the second 10 11 12
#   points, 3 x 6: 6 rows, the second 30 40 50
#   points, 6 x 4: 8 rows, the second 1 10 11
#   points, 5 x 4: ValueError
#   quaternions, 4 x 3: 3 rows
#   attribute, 3 x 6: 6 rows, the second 30 40 50
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet usd-core==26.11 numpy 2>pip.log
tools/bin/python - <<'PY'
import sys

import numpy as np
from pxr import Usd, Vt

points = 10.0 * np.arange(6, dtype=np.float32)[:, None] + np.array([0, 1, 2], np.float32)
points[0] = [0, 0, 0]
homogeneous = np.hstack([points, np.ones((6, 1), np.float32)])
columns = np.ascontiguousarray(points.T)
stage = Usd.Stage.CreateInMemory()
attribute = stage.DefinePrim("/scene", "ParticleField3DGaussianSplat").GetAttribute("positions")


def set_attribute(array):
    attribute.Set(array)
    return attribute.Get()


counts = {}
for title, make, array in [
    ("points, 6 x 3", Vt.Vec3fArray.FromNumpy, points),
    ("points, 3 x 6", Vt.Vec3fArray.FromNumpy, columns),
    ("points, 6 x 4", Vt.Vec3fArray.FromNumpy, homogeneous),
    ("points, 5 x 4", Vt.Vec3fArray.FromNumpy, homogeneous[:5]),
    ("quaternions, 4 x 3", Vt.QuatfArray.FromNumpy, points[:4]),
    ("attribute, 3 x 6", set_attribute, columns),
]:
    try:
        made = make(array)
    except ValueError:
        print(f"{title}: ValueError")
        counts[title] = None
        continue
    row = "" if title.startswith("quat") else ", the second " + " ".join(f"{number:g}" for number in made[1])
    print(f"{title}: {len(made)} rows{row}")
    counts[title] = len(made)
sys.exit(list(counts.values()) != [6, 6, 8, None, 3, 6])
PY

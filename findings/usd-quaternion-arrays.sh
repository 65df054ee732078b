#!/usr/bin/env bash
# usd-core: arrays of quaternions take x, y, z, w from NumPy, single quaternions w, x, y, z.
#
# One would expect: the four columns of an array given to Vt.QuatfArray.FromNumpy to be in the order of the constructor
#   Gf.Quatf(real, i, j, k), which is also the order in which a quaternion prints, and the order of 3DGS files.
# What happens: the real part is the last column, without a warning. np.array() of such an array is x, y, z, w, too.
# Package: usd-core 26.11 (PyPI). Date: 2026-11-27.
# Why it matters: `orientations` of ParticleField3DGaussianSplat are written through such arrays. Columns w, x, y, z of a
#   PLY make a valid file in which every Gaussian is turned another way.
# Output seen:
#   Gf.Quatf(1, 2, 3, 4): real 1.0, printed (1, 2, 3, 4)
#   Vt.QuatfArray.FromNumpy([[1, 2, 3, 4]]): real 4.0, printed (4, 1, 2, 3)
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet usd-core==26.11 numpy
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from pxr import Gf, Vt

one = Gf.Quatf(1, 2, 3, 4)
first = Vt.QuatfArray.FromNumpy(np.array([[1, 2, 3, 4]], np.float32))[0]
print(f"Gf.Quatf(1, 2, 3, 4): real {one.GetReal()}, printed {one}")
print(f"Vt.QuatfArray.FromNumpy([[1, 2, 3, 4]]): real {first.GetReal()}, printed {first}")
sys.exit(one.GetReal() != 1 or first.GetReal() != 4)
PY

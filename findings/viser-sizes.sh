#!/usr/bin/env bash
# viser keeps covariances of Gaussians in half floats: sizes below 0.00017 become 0, sizes above 256 infinite.
#
# One would expect: float32, as positions have, or half floats of sizes, which hold 0.00000006 to 65504.
# What happens: the six numbers of the covariance, which are squares of sizes, are cast to half floats. Their smallest step
#   is 0.00024 squared, so sizes below 0.001 keep one digit or two, and turned discs another shape. Of what overflows,
#   NumPy warns once; of the rest nothing is said.
# Package: viser 1.1.1 (PyPI). Date: 2026-11-29.
# Why it matters: objects that were scaled to length 1 have sizes of 0.0001 to 0.01, and skies sizes of hundreds: surfaces
#   turn grainy in this viewer, and skies go. Scale positions and covariances of a scene before, and its node back.
# Output seen:
#   size 0.0001: kept as 0
#   size 0.0003: kept as 0.000345
#   size 0.001: kept as 0.00101
#   size 1: kept as 1
#   size 300: kept as inf
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet viser==1.1.1 numpy 2>pip.log
tools/bin/python -W ignore - <<'PY'
import contextlib
import io
import sys

import numpy as np
import viser

SIZES = np.array([0.0001, 0.0003, 0.001, 1, 300], np.float32)
with contextlib.redirect_stdout(io.StringIO()):
    server = viser.ViserServer(host="127.0.0.1")
scene = {
    "centers": np.zeros((5, 3), np.float32),
    "covariances": SIZES[:, None, None] ** 2 * np.eye(3, dtype=np.float32),
    "rgbs": np.full((5, 3), 0.5),
    "opacities": np.ones((5, 1)),
}
# A Gaussian's buffer has its centre, one word for the renderer, then three words of covariance and one of colour.
handle = server.scene.add_gaussian_splats("/scene", **scene)
words = np.ascontiguousarray(handle.buffer[:, 4:7])
kept = np.sqrt(words.view(np.float16)[:, 0].astype(float))
with contextlib.redirect_stdout(io.StringIO()):
    server.stop()
for size, found in zip(SIZES, kept):
    print(f"size {size:g}: kept as {found:.3g}")
sys.exit(not np.allclose(kept, [0, 0.000345, 0.00101, 1, np.inf], rtol=0.01))
PY

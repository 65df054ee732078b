#!/usr/bin/env bash
# NVIDIA's converter to USD turns Gaussians, and leaves their harmonics as they were.
#
# One would expect: --rotate-x 180, by which its README corrects the orientation of a PLY, turns all that has a direction:
#   positions, rotations, and the harmonics, as splat-transform does.
# What happens: positions and orientations are turned. The coefficients of all degrees stay, so each Gaussian shows to one
#   side what it was trained to show to the other. Nothing is said.
# Packages: usd-convert-gsplat 0.1.15 and usd-core 26.11 (PyPI), @playcanvas/splat-transform 3.7.0 (npm).
#   Date: 2026-11-29.
# Why it matters: trained scenes have y down, USD has y up, so nearly every scene needs the turn. Highlights lie on the
#   wrong side, which looks like a poor training. Convert without it, and turn the prim by a transform.
# Output seen (position, and the three coefficients of degree 1):
#   in the PLY: 1 2 3, 0.1 0.2 0.3
#   splat-transform -r 180,0,0: 1 -2 -3, -0.1 -0.2 0.3
#   usd-convert-gsplat --rotate-x 180: 1 -2 -3, 0.1 0.2 0.3
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @playcanvas/splat-transform@3.7.0 >>npm.log
python3 -m venv tools
tools/bin/pip install --quiet usd-convert-gsplat==0.1.15 usd-core==26.11 numpy 2>pip.log
tools/bin/python - <<'PY'
import subprocess
import sys
from pathlib import Path

import numpy as np
from pxr import Usd

REST = [f"f_rest_{index}" for index in range(9)]
NAMES = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", *REST, "opacity"]
NAMES += ["scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
POSITION, DEGREE_1 = [1, 2, 3], [0.1, 0.2, 0.3]
row = np.array([*POSITION, 0, 0, 0, *3 * DEGREE_1, 1, -3, -3, -3, 1, 0, 0, 0], "<f4")
head = ["ply", "format binary_little_endian 1.0", "element vertex 1", *(f"property float {name}" for name in NAMES)]
Path("scene.ply").write_bytes("\n".join([*head, "end_header", ""]).encode() + row.tobytes())


def read_row(file):
    head, _, body = Path(file).read_bytes().partition(b"end_header\n")
    names = [line.split()[-1].decode() for line in head.splitlines() if line.startswith(b"property")]
    return dict(zip(names, np.frombuffer(body, "<f4")))


subprocess.run(["npx", "splat-transform", "-q", "-w", "scene.ply", "-r", "180,0,0", "turned.ply"], check=True)
turned = read_row("turned.ply")
converter = ["tools/bin/usd-convert-gsplat", "-i", "scene.ply", "-o", "turned.usda", "--rotate-x", "180"]
subprocess.run(converter, check=True, stdout=subprocess.DEVNULL)
stage = Usd.Stage.Open("turned.usda")
prim = stage.GetDefaultPrim()
coefficients = np.array(prim.GetAttribute("radiance:sphericalHarmonicsCoefficients").Get())
found = {
    "in the PLY": (POSITION, DEGREE_1),
    "splat-transform -r 180,0,0": ([turned[axis] for axis in "xyz"], [turned[name] for name in REST[:3]]),
    "usd-convert-gsplat --rotate-x 180": (np.array(prim.GetAttribute("positions").Get())[0], coefficients[1:, 0]),
}
for title, parts in found.items():
    print(f"{title}:", ", ".join(" ".join(f"{round(float(value), 3):g}" for value in part) for part in parts))
positions, harmonics = ([[float(value) for value in parts[index]] for parts in found.values()] for index in (0, 1))
as_described = np.allclose(positions[1:], [1, -2, -3], atol=1e-4)
as_described &= np.allclose(harmonics, [DEGREE_1, [-0.1, -0.2, 0.3], DEGREE_1], atol=1e-4)
sys.exit(not as_described)
PY

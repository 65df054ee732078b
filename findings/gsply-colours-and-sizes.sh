#!/usr/bin/env bash
# gsply keeps track of units of sizes, opacities and colours, but its writer takes them for one.
#
# One would expect: a scene whose sizes, opacities or colours were turned to other units, which gsply remembers, to come
#   back from a PLY as it was: save and plywrite turn sizes and opacities back.
# What happens: after to_rgb, the colours of degree 0 are written as they are, as f_dc. A red of 1.0 is read as 0.78, black
#   becomes grey. And where only the opacities are linear, as renderers keep them, from_arrays knows that the
#   sizes are logarithms, and save takes their logarithms again: every Gaussian has a size of 1e-9. Nothing is said.
# Package: gsply 0.4.6 (PyPI). Date: 2026-11-28.
# Why it matters: the file is valid, and looks washed out or empty. Call to_sh, and normalize, or give all attributes in
#   PLY's units with format="ply".
# Output seen:
#   colours after to_rgb: [1.0, 0.5, -0.0], read from the PLY: [0.78, 0.64, 0.5]
#   log sizes -3 with linear opacities, known as scales_ply and opacities_linear: written as -20.7
#   log sizes -3 with logits: written as -3.0
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet gsply==0.4.6 numpy==2.4.6 2>pip.log
tools/bin/python - <<'PY'
import sys

import numpy as np
from gsply import GSData, SH_C0, plyread


def scene(opacities, colours=(0.0, 0.0, 0.0)):
    count = len(opacities)
    return GSData.from_arrays(
        means=np.zeros((count, 3), np.float32),
        scales=np.full((count, 3), -3, np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        opacities=np.array(opacities, np.float32),
        sh0=np.tile(np.array(colours, np.float32), (count, 1)),
    )


half = 0.5 / SH_C0
coloured = scene([-2, 3], (half, 0, -half)).to_rgb()
given = coloured.sh0[0].copy()
coloured.save("colours.ply")
read = plyread("colours.ply").sh0[0] * SH_C0 + 0.5
print(f"colours after to_rgb: {given.round(2).tolist()}, read from the PLY: {[round(float(c), 2) for c in read]}")
mixed = scene([0.2, 0.9])
known = f"{mixed.format_state['scales'].value} and {mixed.format_state['opacities'].value}"
mixed.save("mixed.ply")
scene([-2, 3]).save("plain.ply")
sizes = [float(plyread(name).scales[0, 0]) for name in ("mixed.ply", "plain.ply")]
print(f"log sizes -3 with linear opacities, known as {known}: written as {sizes[0]:.1f}")
print(f"log sizes -3 with logits: written as {sizes[1]:.1f}")
sys.exit(not (np.allclose(read, given * SH_C0 + 0.5, atol=1e-3) and sizes[0] < -20 and abs(sizes[1] + 3) < 1e-3))
PY

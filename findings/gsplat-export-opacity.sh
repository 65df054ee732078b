#!/usr/bin/env bash
# gsplat's exporter leaves out every Gaussian of a scene if one opacity is not finite.
#
# One would expect: export_splats leaves out the Gaussians that have a NaN or an infinity, and writes the others, as it does
#   for one in sizes, rotations and colours.
# What happens: the check of opacities asks whether any of all is not finite, and holds the answer against each Gaussian. One
#   infinite opacity among a thousand gives a valid PLY of no Gaussian, and no error; .splat and compressed PLY raise an
#   IndexError about a reduction.
# Packages: gsplat 1.5.3 and torch 2.13.0 (PyPI). Date: 2026-11-29.
# Why it matters: an infinite logit is what other tools make of opaque Gaussians (compressed PLY, SPZ), and a NaN what a
#   training step may leave: the whole scene is gone where one Gaussian, or none, had to go. Clamp opacities before.
# Output seen:
#   finite: 1000 Gaussians of 1000 written
#   one infinite size: 999 Gaussians of 1000 written
#   one infinite opacity: 0 Gaussians of 1000 written
#   one infinite opacity, as splat: IndexError
#   one infinite opacity, as ply_compressed: IndexError
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet gsplat==1.5.3 torch==2.13.0 numpy 2>pip.log
tools/bin/python - 2>python.log <<'PY'
import math
import re
import sys

import torch
from gsplat import export_splats

COUNT = 1000


def export(format="ply", **one):
    generator = torch.Generator().manual_seed(0)
    shapes = {"means": (3,), "scales": (3,), "quats": (4,), "opacities": (), "sh0": (1, 3), "shN": (3, 3)}
    scene = {name: torch.randn(COUNT, *shape, generator=generator) for name, shape in shapes.items()}
    for name, value in one.items():
        scene[name].view(COUNT, -1)[7, 0] = value
    try:
        return int(re.search(rb"element vertex (\d+)", export_splats(**scene, format=format))[1])
    except IndexError as error:
        return type(error).__name__


found = {
    "finite": export(),
    "one infinite size": export(scales=math.inf),
    "one infinite opacity": export(opacities=math.inf),
}
for title, count in found.items():
    print(f"{title}: {count} Gaussians of {COUNT} written")
others = [export(format, opacities=math.inf) for format in ("splat", "ply_compressed")]
print(f"one infinite opacity, as splat: {others[0]}\none infinite opacity, as ply_compressed: {others[1]}")
sys.exit([*found.values(), *others] != [COUNT, COUNT - 1, 0, "IndexError", "IndexError"])
PY

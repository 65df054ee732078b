#!/usr/bin/env bash
# Mitsuba's ellipsoids turn with to_world, but their harmonics stay; three unequal scales become their mean.
#
# One would expect: a scene of INRIA's PLY under a transform to look as the same scene from a camera that moved the other way.
# What happens: to_world changes positions, rotations and sizes alone. The harmonics are those of the file, so each lobe points
#   where it pointed before: what was bright from +x and now lies towards +y is still bright from +x. A transform of scales 1, 2
#   and 4 puts positions 1, 2 and 4 times as far, and makes each Gaussian 7/3 as large along all of its axes.
# Package: mitsuba 3.9.1 (PyPI). Date: 2026-11-30.
# Why it matters: captures come with y down and are turned upright by to_world, as every mesh is. The picture is sharp and has
#   reflections from the wrong side. Turn harmonics with the scene before, or move the camera.
# Output seen (red from +x and from +y, length of the axes):
#   as in the file: red 0.90 0.50, axes 0.10 0.20 0.30
#   turned by 90 degrees, x to y: red 0.90 0.50, should be 0.50 0.90; axes 0.10 0.20 0.30, along y x z
#   scaled by 1 2 4: position 1 2 4, axes 0.23 0.47 0.70, should be 0.10 0.40 1.20
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet mitsuba==3.9.1 numpy 2>pip.log
tools/bin/python - <<'PY'
import math
import sys
from pathlib import Path

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
# The colour is 0.5 + 0.4 x of the direction from the Gaussian to the eye: of degree 1 INRIA's basis has -C1 x times the third
# coefficient, with x of the direction from the eye to the Gaussian.
C1 = math.sqrt(3 / (4 * math.pi))
names = ["x", "y", "z", "nx", "ny", "nz", *(f"f_dc_{index}" for index in range(3)), *(f"f_rest_{index}" for index in range(9))]
names += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
row = dict.fromkeys(names, 0.0)
row |= {"x": 1, "y": 1, "z": 1, "f_rest_2": 0.4 / C1, "rot_0": 1}
row |= {f"scale_{axis}": math.log((axis + 1) / 10) for axis in range(3)}
head = ["ply", "format binary_little_endian 1.0", "element vertex 1"]
head += [*(f"property float {name}" for name in names), "end_header", ""]
Path("one.ply").write_bytes("\n".join(head).encode() + np.array([row[name] for name in names], "<f4").tobytes())


def load(**transform):
    found = mi.traverse(mi.load_dict({"type": "ellipsoids", "filename": "one.ply", **transform}))
    data, harmonics = np.array(found["data"]), np.array(found["sh_coeffs"]).reshape(4, 3)
    x, y, z, w = data[6:]
    turn = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    reds = [0.5 + C1 * harmonics[place, 0] for place in (3, 1)]
    along = " ".join("xyz"[axis] for axis in np.abs(turn).argmax(axis=0))
    return data[:3], data[3:6], along, reds


say = lambda numbers: " ".join(f"{number:.2f}" for number in numbers)
_, sizes, _, reds = load()
print(f"as in the file: red {say(reds)}, axes {say(sizes)}")
transform = mi.ScalarTransform4f()
_, turned_sizes, along, turned_reds = load(to_world=transform.rotate([0, 0, 1], 90))
print(f"turned by 90 degrees, x to y: red {say(turned_reds)}, should be {say(reds[::-1])}; "
      f"axes {say(turned_sizes)}, along {along}")
place, scaled, _, _ = load(to_world=transform.scale([1, 2, 4]))
print(f"scaled by 1 2 4: position {' '.join(f'{number:.0f}' for number in place)}, axes {say(scaled)}, "
      f"should be {say(sizes * [1, 2, 4])}")
as_described = np.allclose(reds, [0.9, 0.5]) and np.allclose(turned_reds, reds) and along == "y x z"
sys.exit(not (as_described and np.allclose(place, [1, 2, 4]) and np.allclose(scaled, sizes * 7 / 3)))
PY

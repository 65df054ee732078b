#!/usr/bin/env bash
# Open3D leaves an infinity out of a PLY that it writes: all that follows moves up by one number, and it returns True.
#
# One would expect: an infinity to be written as one, as NaN is, in a binary file of floats; or write_point_cloud to return False.
# What happens: the infinite number is skipped, in binary and in text. Every later number of the file stands where the one before it
#   belongs, across rows and columns, and the file ends 4 bytes early for each infinity. A line about RPly goes to the terminal.
#   The reader of the same library logs a warning, and returns the rows that moved.
# Packages: open3d 0.20.0, with libusb-package 1.0.30.0 for its libusb (PyPI). Date: 2026-11-30.
# Why it matters: an infinite logit is what other tools make of opaque Gaussians (compressed PLY, SPZ). A scene of them that is
#   loaded, cut and saved is noise behind the first opaque one. Clamp opacities before.
# Output seen (x is 1, 2, 3 and 4, opacity 10, 20, 30 and 40 but for the second):
#   finite, binary: returned True, 0 bytes missing, x 1 2 3 4, opacity 10 20 30 40; read again x 1 2 3 4
#   NaN, binary: returned True, 0 bytes missing, x 1 2 3 4, opacity 10 nan 30 40; read again x 1 2 3 4
#   infinite, binary: returned True, 4 bytes missing, x 1 2 -3 -4, opacity 10 0 0 0; read again x 1 2 -3 -4
#   infinite, text: returned True, numbers 55 of 56
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet open3d==0.20.0 libusb-package==1.0.30.0 numpy==2.4.6 2>pip.log
# The library under the name by which Open3D asks for it.
ln -s "$(tools/bin/python -c 'import libusb_package; print(libusb_package.get_library_path())')" libusb-1.0.so.0
LD_LIBRARY_PATH="$folder" tools/bin/python - 2>rply.log <<'PY'
import sys
from pathlib import Path

import numpy as np
import open3d as o3d

tensor = o3d.core.Tensor
o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)


def write(name, opacity, text=False):
    """What write_point_cloud returns, and the file's columns and body."""
    cloud = o3d.t.geometry.PointCloud(tensor(np.float32([[1, -1, 0], [2, -2, 0], [3, -3, 0], [4, -4, 0]])))
    cloud.point.opacity = tensor(np.float32([[10], [opacity], [30], [40]]))
    cloud.point.scale = tensor(np.ones((4, 3), np.float32))
    cloud.point.rot = tensor(np.tile(np.float32([0.8, 0.6, 0, 0]), (4, 1)))
    cloud.point.f_dc = tensor(np.zeros((4, 3), np.float32))
    returned = o3d.t.io.write_point_cloud(name, cloud, write_ascii=text)
    header, body = Path(name).read_bytes().split(b"end_header\n", 1)
    return returned, [line.split()[2].decode() for line in header.split(b"\n") if line.startswith(b"property")], body


missing = []
for title, opacity in (("finite", 20), ("NaN", np.nan), ("infinite", np.inf)):
    returned, columns, body = write("scene.ply", opacity)
    numbers, width = np.frombuffer(body, "<f4"), len(columns)
    missing.append(4 * width * 4 - len(body) if returned else None)
    x, o = (" ".join(f"{number:g}" for number in numbers[columns.index(name) :: width]) for name in ("x", "opacity"))
    again = o3d.t.io.read_point_cloud("scene.ply").point.positions.numpy()[:, 0]
    x_again = " ".join(f"{number:g}" for number in again)
    print(f"{title}, binary: returned {returned}, {missing[-1]} bytes missing, x {x}, opacity {o}; read again x {x_again}")
    if title == "infinite":
        returned, columns, body = write("text.ply", opacity, text=True)
        print(f"infinite, text: returned {returned}, numbers {len(body.split())} of {4 * width}")
        missing.append(4 * width - len(body.split()) if returned else None)
sys.exit(missing != [0, 0, 4, 1])
PY

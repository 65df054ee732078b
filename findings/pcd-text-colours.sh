#!/usr/bin/env bash
# pypcd4 and pcd-py write black for every colour of a PCD in text.
#
# One would expect: text to hold the same points as the two binary encodings, as pointcloudkit's does; at most, positions lose digits.
# What happens: text has a fixed number of decimals, 10 of pypcd4 and 6 of pcd-py. A PCD keeps a colour as the bits of a float, and
#   these bits are numbers of about 1e-38: all are written as 0.000000, which is black. Nothing is said; fields, count and
#   positions are right. Other small numbers, such as variances, become 0 the same way.
# Packages: pypcd4 1.5.1, pcd-py 0.2.0 and pointcloudkit 0.1.0 (PyPI). Date: 2026-11-30.
# Why it matters: text is what one takes to look into a cloud, or for a tool that does not read the packed encoding. The points that
#   start a training are black, which passes for a cloud without colours. Write binary, or rgb as a field of type U.
# Output seen (colours 255 64 128, 10 20 30 and 200 200 200):
#   pypcd4 BINARY: 255 64 128, 10 20 30, 200 200 200
#   pypcd4 BINARY_COMPRESSED: 255 64 128, 10 20 30, 200 200 200
#   pypcd4 ASCII: 0 0 0, 0 0 0, 0 0 0
#   pypcd4 ASCII, type U: 255 64 128, 10 20 30, 200 200 200
#   pcd-py binary: 255 64 128, 10 20 30, 200 200 200
#   pcd-py ascii: 0 0 0, 0 0 0, 0 0 0
#   pointcloudkit ascii: 255 64 128, 10 20 30, 200 200 200
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet pypcd4==1.5.1 pcd-py==0.2.0 pointcloudkit==0.1.0 numpy 2>pip.log
tools/bin/python - <<'PY' | tee seen
import sys

import numpy as np
import pcd_py
import pointcloudkit
from pypcd4 import Encoding, PointCloud

COLOURS = np.array([[255, 64, 128], [10, 20, 30], [200, 200, 200]], np.uint8)
places = np.arange(9, dtype=np.float32).reshape(3, 3) / 8
packed = PointCloud.encode_rgb(COLOURS)
as_floats = PointCloud.from_xyzrgb_points(np.column_stack([places, packed]))
columns = [*places.T, packed.view(np.uint32)]
as_words = PointCloud.from_points(columns, ("x", "y", "z", "rgb"), (np.float32, np.float32, np.float32, np.uint32))
by_name = dict(zip("xyz", np.ascontiguousarray(places.T))) | {"rgb": packed}
of_kit = pointcloudkit.PointCloud(places.astype(np.float64), rgb=COLOURS)
for title, write in [
    ("pypcd4 BINARY", lambda path: as_floats.save(path, Encoding.BINARY)),
    ("pypcd4 BINARY_COMPRESSED", lambda path: as_floats.save(path, Encoding.BINARY_COMPRESSED)),
    ("pypcd4 ASCII", lambda path: as_floats.save(path, Encoding.ASCII)),
    ("pypcd4 ASCII, type U", lambda path: as_words.save(path, Encoding.ASCII)),
    ("pcd-py binary", lambda path: pcd_py.write_pcd(path, by_name, format="binary")),
    ("pcd-py ascii", lambda path: pcd_py.write_pcd(path, by_name, format="ascii")),
    ("pointcloudkit ascii", lambda path: of_kit.write(path, binary=False)),
]:
    write("points.pcd")
    read = PointCloud.from_path("points.pcd")
    if not np.array_equal(read.numpy(("x", "y", "z")), places):
        sys.exit(f"{title}: positions differ")
    colours = PointCloud.decode_rgb(read.pc_data["rgb"])
    print(f"{title}: {', '.join(' '.join(map(str, colour)) for colour in colours)}")
PY
diff seen - <<'END'
pypcd4 BINARY: 255 64 128, 10 20 30, 200 200 200
pypcd4 BINARY_COMPRESSED: 255 64 128, 10 20 30, 200 200 200
pypcd4 ASCII: 0 0 0, 0 0 0, 0 0 0
pypcd4 ASCII, type U: 255 64 128, 10 20 30, 200 200 200
pcd-py binary: 255 64 128, 10 20 30, 200 200 200
pcd-py ascii: 0 0 0, 0 0 0, 0 0 0
pointcloudkit ascii: 255 64 128, 10 20 30, 200 200 200
END

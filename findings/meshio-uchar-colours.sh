#!/usr/bin/env bash
# meshio reads the uchar columns of a binary PLY with a sign: white is -1.
#
# One would expect: red of 255, in the type that PLY's writers use for colours, to be 255, as in the same file in text, or with
#   the type's other name, uint8.
# What happens: uchar is taken for a signed byte in both binary formats, so values above 127 are 256 less. A copy that meshio
#   writes has columns of int8. The type ushort is in no table of the reader: KeyError.
# Packages: meshio 5.3.5 and plyfile 1.1.5 (PyPI). Date: 2026-11-30.
# Why it matters: COLMAP, Open3D, MeshLab and plyfile write uchar. Colours of points that start a training wrap round: the
#   bright half of the picture becomes black where they are clipped, and readers of the copy refuse it or show other colours.
# Output seen (red of three points, written as 0, 127 and 255, and the type of red in a copy):
#   ascii uchar: 0 127 255, copy u1
#   ascii uint8: 0 127 255, copy u1
#   binary_little_endian uchar: 0 127 -1, copy i1
#   binary_little_endian uint8: 0 127 255, copy u1
#   binary_big_endian uchar: 0 127 -1, copy i1
#   binary_big_endian uint8: 0 127 255, copy u1
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet meshio==5.3.5 plyfile==1.1.5 numpy 2>pip.log
tools/bin/python - <<'PY'
import sys
from pathlib import Path

import meshio
import numpy as np
from plyfile import PlyData

ORDERS = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}
COLUMNS = ["float x", "float y", "float z"]
REDS = [0, 127, 255]
as_described = True
for form, order in ORDERS.items():
    for kind in ("uchar", "uint8"):
        columns = [*COLUMNS, *(f"{kind} {name}" for name in ("red", "green", "blue"))]
        head = ["ply", f"format {form} 1.0", "element vertex 3"]
        head += [*(f"property {column}" for column in columns), "end_header", ""]
        if order is None:
            body = "".join(f"{row} {row} {row} {red} 10 20\n" for row, red in enumerate(REDS)).encode()
        else:
            rows = np.zeros(3, [("place", order + "f4", 3), ("colour", "u1", 3)])
            rows["place"] = np.arange(3)[:, None]
            rows["colour"] = [(red, 10, 20) for red in REDS]
            body = rows.tobytes()
        Path("points.ply").write_bytes("\n".join(head).encode() + body)
        mesh = meshio.read("points.ply")
        read = mesh.point_data["red"].tolist()
        mesh.write("copy.ply")
        written = next(column.val_dtype for column in PlyData.read("copy.ply")["vertex"].properties if column.name == "red")
        print(f"{form} {kind}: {' '.join(map(str, read))}, copy {written}")
        wrong = order is not None and kind == "uchar"
        as_described &= read == ([0, 127, -1] if wrong else REDS) and written == ("i1" if wrong else "u1")
sys.exit(not as_described)
PY

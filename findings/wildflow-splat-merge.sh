#!/usr/bin/env bash
# wildflow's merge_ply_files glues the bytes of scenes together and tells of success, whatever their columns are.
#
# One would expect: scenes of other columns than the first, which its documentation asks not to give, to be refused; or columns
#   to be matched by name where all have the same ones in another order.
# What happens: rows are copied behind the first file's header. Of the same columns in another order, x takes what the second
#   file has first. Of a scene with harmonics behind one without, rows are read at the wrong places, and bytes are left
#   over at the end. Both times it prints "Successfully merged" and the sum of the counts.
# Package: wildflow-splat 0.1.7 (PyPI). Date: 2026-11-29.
# Why it matters: trainers write columns in different orders, with or without normals and harmonics, and a tool for parts of a
#   large site gets parts of several trainings. Compare the headers before.
# Output seen:
#   other order: rows told 4, x 1 2 -3 -3, opacity 2 2 3 4; bytes beyond the rows: 0
#   with harmonics: rows told 4, x 1 2 3 0.5, opacity 2 2 0.5 0; bytes beyond the rows: 72
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet wildflow-splat==0.1.7 numpy 2>pip.log
cat >merge.py <<'PY'
import sys
from pathlib import Path

import numpy as np
from wildflow import splat

NAMES = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
REST = [f"f_rest_{index}" for index in range(9)]
VALUES = {"opacity": 2, "scale_0": -3, "scale_1": -3, "scale_2": -3, "rot_0": 1} | dict.fromkeys(REST, 0.5)


def write(name, names, places):
    rows = np.array([[place if column == "x" else VALUES.get(column, 0) for column in names] for place in places], "<f4")
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}", *(f"property float {column}" for column in names)]
    Path(name).write_bytes("\n".join([*head, "end_header", ""]).encode() + rows.tobytes())


write("first.ply", NAMES, [1, 2])
cases = {
    "other order": ["scale_2", "scale_1", "scale_0", "rot_0", "rot_1", "rot_2", "x", *NAMES[1:7], "rot_3"],
    "with harmonics": [*NAMES[:6], *REST, *NAMES[6:]],
}
found = []
for title, names in cases.items():
    write("second.ply", names, [3, 4])
    splat.merge_ply_files({"input_files": ["first.ply", "second.ply"], "output_file": "merged.ply"})
    header, _, body = Path("merged.ply").read_bytes().partition(b"end_header\n")
    columns = [line.split()[-1].decode() for line in header.splitlines() if line.startswith(b"property")]
    count = int(header.split(b"element vertex ")[1].split()[0])
    rows = np.frombuffer(body, "<f4", count * len(columns)).reshape(count, -1)
    places, opacities = (rows[:, columns.index(name)] for name in ("x", "opacity"))
    beyond = len(body) - rows.nbytes
    told = [" ".join(f"{value:g}" for value in column) for column in (places, opacities)]
    print(f"{title}: rows told {count}, x {told[0]}, opacity {told[1]}; bytes beyond the rows: {beyond}", file=sys.stderr)
    found.append((places.tolist(), beyond))
sys.exit(found != [([1, 2, -3, -3], 0), ([1, 2, 3, 0.5], 72)])
PY
tools/bin/python merge.py >merge.log

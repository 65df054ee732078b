#!/usr/bin/env bash
# 3dgs-edit-tools stretches the colours of each scene to the range 0 to 1, and joins scenes in the stretched ones.
#
# One would expect: scenes joined by merge_3dgs_files, or taken to CSV and back, keep the Gaussians that they have.
# What happens: the CSV holds f_dc as (f_dc - lowest) / (highest - lowest) of its file. Coming back, numbers from 0 to 1 are
#   taken for stretched ones and spread over a range that is kept in a variable of the process: that of the last file
#   read, or -3 to 3 in a new process. So a join gives the first scene the range of the second, and a CSV that is
#   converted by another command has other contrast. A scene whose f_dc are all above 0 does not come back at all.
# Package: 3dgs-edit-tools 0.3.0 (PyPI). Date: 2026-11-29.
# Why it matters: joining and editing in CSV is what the package is for. Sizes and places are right, so the wrong colours
#   look like another exposure. Keep f_dc of the sources, or join with another tool.
# Output seen:
#   bright scene: f_dc_0 -1.00 0.20 1.50, there and back -1.00 0.20 1.50, by a second process -3.00 -0.12 3.00
#   pale scene: f_dc_0 0.10 0.20 0.40, there and back 0.17 0.25 0.40, by a second process -1.50 0.00 3.00
#   joined: f_dc_0 0.10 0.24 0.40 0.17 0.25 0.40
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet 3dgs-edit-tools==0.3.0 numpy pandas matplotlib 2>pip.log
# The package imports Open3D at its start, and needs it for meshes alone.
touch open3d.py
cat >edit.py <<'PY'
import contextlib
import io
import subprocess
import sys
from pathlib import Path

import numpy as np

with contextlib.redirect_stdout(io.StringIO()):
    from src import convert_3dgs_to_csv, convert_csv_to_3dgs, merge_3dgs_files

    if len(sys.argv) > 1:
        convert_csv_to_3dgs(sys.argv[1], None, sys.argv[2])
        sys.exit()

NAMES = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]


def write(name, reds):
    rows = np.zeros((len(reds), len(NAMES)), "<f4")
    rows[:, NAMES.index("rot_0")] = 1
    rows[:, 3:6] = np.array(reds)[:, None]
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(reds)}", *(f"property float {name}" for name in NAMES)]
    Path(name).write_bytes("\n".join([*head, "end_header", ""]).encode() + rows.tobytes())


def read_reds(name):
    body = Path(name).read_bytes().partition(b"end_header\n")[2]
    return np.frombuffer(body, "<f4").reshape(-1, len(NAMES))[:, 3]


found = []
scenes = {"bright": [-1, 0.2, 1.5], "pale": [0.1, 0.2, 0.4]}
for name, reds in scenes.items():
    write(f"{name}.ply", reds)
    with contextlib.redirect_stdout(io.StringIO()):
        convert_3dgs_to_csv(f"{name}.ply", f"{name}.csv")
        convert_csv_to_3dgs(f"{name}.csv", None, "back.ply")
    subprocess.run([sys.executable, "edit.py", f"{name}.csv", "later.ply"], check=True)
    found += [read_reds("back.ply"), read_reds("later.ply")]
    texts = [" ".join(f"{red:.2f}" for red in numbers) for numbers in (reds, *found[-2:])]
    print(f"{name} scene: f_dc_0 {texts[0]}, there and back {texts[1]}, by a second process {texts[2]}")
with contextlib.redirect_stdout(io.StringIO()):
    merge_3dgs_files("bright.ply", "pale.ply", "joined.ply")
found.append(read_reds("joined.ply"))
print("joined: f_dc_0", *(f"{red:.2f}" for red in found[-1]))
expected = [-1, 0.2, 1.5, -3, -0.12, 3, 0.175, 0.25, 0.4, -1.5, 0, 3, 0.1, 0.244, 0.4, 0.175, 0.25, 0.4]
sys.exit(not np.allclose(np.concatenate(found), expected, atol=0.01))
PY
tools/bin/python edit.py

#!/usr/bin/env bash
# gaussforge writes the harmonics of a compressed PLY coefficient by coefficient, under names that mean colour by colour.
#
# One would expect: f_rest_1 of a PLY to be f_rest_1 of the compressed PLY made of it, to the step of its bytes: the format
#   keeps INRIA's names and their order, all of red first.
# What happens: column f_rest_1 holds f_rest_15, column f_rest_2 f_rest_30 and so on: red, green and blue of the first
#   coefficient, then of the second. splat-transform reads other numbers than were written, and so does gaussforge
#   itself. Columns 0 and 44 are right.
# Packages: gaussforge 0.6.0 (PyPI) and @playcanvas/splat-transform 3.7.0 (npm). Date: 2026-11-28.
# Why it matters: colours that depend on direction are wrong in every viewer, by a swap of colours and lobes that looks like
#   a poor training. Its PLY, SPZ and SOG are right: convert through one of these.
# Output seen:
#   in the PLY: f_rest_0 -0.88, f_rest_1 -0.84, f_rest_2 -0.80, f_rest_15 -0.28, f_rest_30 0.32, f_rest_44 0.88
#   read by splat-transform: f_rest_0 -0.89, f_rest_1 -0.27, f_rest_2 0.33, f_rest_15 -0.67, f_rest_30 -0.48, f_rest_44 0.89
#   read by gaussforge: f_rest_0 -0.89, f_rest_1 -0.27, f_rest_2 0.33, f_rest_15 -0.67, f_rest_30 -0.48, f_rest_44 0.89
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @playcanvas/splat-transform@3.7.0 >>npm.log
python3 -m venv tools
tools/bin/pip install --quiet gaussforge==0.6.0 numpy==2.4.6 2>pip.log
tools/bin/python - <<'PY'
import csv
import subprocess
import sys

import numpy as np
from gaussforge import GaussForge

REST = [f"f_rest_{index}" for index in range(45)]
NAMES = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", *REST, "opacity"]
NAMES += ["scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
SHOWN = (0, 1, 2, 15, 30, 44)
row = np.zeros((2, len(NAMES)), "<f4")
row[1, :3] = 1
row[:, 6:51] = (np.arange(45) - 22) / 25
row[:, 51:] = [1, -3, -3, -3, 1, 0, 0, 0]
head = ["ply", "format binary_little_endian 1.0", "element vertex 2", *(f"property float {name}" for name in NAMES)]
forge = GaussForge()
packed = forge.convert("\n".join([*head, "end_header", ""]).encode() + row.tobytes(), "ply", "compressed.ply")["data"]
open("packed.compressed.ply", "wb").write(packed)
subprocess.run(["npx", "splat-transform", "-q", "-w", "packed.compressed.ply", "unpacked.csv"], check=True)
first = next(csv.DictReader(open("unpacked.csv")))
again = forge.convert(packed, "compressed.ply", "ply")["data"]
names = [line.split()[-1].decode() for line in again.split(b"end_header")[0].splitlines() if line.startswith(b"property")]
body = np.frombuffer(again[again.index(b"end_header\n") + 11 :], "<f4").reshape(2, len(names))
read = {
    "in the PLY": row[0, 6:51],
    "read by splat-transform": np.array([float(first[name]) for name in REST]),
    "read by gaussforge": np.array([body[0, names.index(name)] for name in REST]),
}
for title, values in read.items():
    print(f"{title}:", ", ".join(f"f_rest_{index} {values[index]:.2f}" for index in SHOWN))
interleaved = row[0, 6:51].reshape(3, 15).T.ravel()
sys.exit(any(np.abs(values - interleaved).max() > 0.02 for values in list(read.values())[1:]))
PY

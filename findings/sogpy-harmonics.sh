#!/usr/bin/env bash
# sogpy writes the harmonics of a SOG with colours and coefficients of the PLY mixed up.
#
# One would expect: f_rest_1 of a PLY to be f_rest_1 of the SOG made of it, to the step of its code book. PLY keeps all of
#   red first, SOG the red, green and blue of each coefficient in one pixel.
# What happens: the columns go into pixels three by three in PLY's order. So f_rest_0, 1 and 2, which are all red, become
#   red, green and blue of the first coefficient. Every reader of SOG shows other numbers, of degrees 1, 2 and 3; the
#   first and the last column are right. Positions, sizes, rotations and base colours are right, too.
# Packages: sogpy 1.0.2 (PyPI) and @playcanvas/splat-transform 3.7.0 (npm). Date: 2026-11-29.
# Why it matters: the scene looks right from afar, and has coloured, moving stains from near, like a poor training. Convert
#   with another tool: the numbers cannot be told from right ones in the file.
# Output seen:
#   degree 1: right 3 of 9; written f_rest_0 0.10 f_rest_1 0.20 f_rest_3 0.40 f_rest_6 0.70, read 0.10 0.40 0.20 0.30
#   degree 2: right 2 of 24; written f_rest_0 0.10 f_rest_1 0.20 f_rest_8 0.90 f_rest_16 1.70, read 0.10 0.40 0.20 0.30
#   degree 3: right 3 of 45; written f_rest_0 0.10 f_rest_1 0.20 f_rest_15 1.60 f_rest_30 3.10, read 0.10 0.40 0.20 0.30
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @playcanvas/splat-transform@3.7.0 >>npm.log
python3 -m venv tools
tools/bin/pip install --quiet sogpy==1.0.2 numpy pillow scipy 2>pip.log
tools/bin/python -W ignore - <<'PY'
import contextlib
import io
import subprocess
import sys
from pathlib import Path

import numpy as np
from SogPython import convert_ply_to_sog

COUNT = 1024
as_described = True
for degree in (1, 2, 3):
    coefficients = (degree + 1) ** 2 - 1
    rest = [f"f_rest_{index}" for index in range(3 * coefficients)]
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", *rest, "opacity"]
    names += ["scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    rows = np.random.default_rng(0).normal(size=(COUNT, len(names))).astype("<f4")
    # All Gaussians have the same harmonics, one number for each column.
    written = np.arange(1, 3 * coefficients + 1) / 10
    rows[:, [names.index(name) for name in rest]] = written
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {COUNT}", *(f"property float {name}" for name in names)]
    Path("scene.ply").write_bytes("\n".join([*head, "end_header", ""]).encode() + rows.tobytes())
    with contextlib.redirect_stdout(io.StringIO()):
        convert_ply_to_sog("scene.ply", "scene.sog")
    subprocess.run(["npx", "splat-transform", "-q", "-w", "scene.sog", "back.ply"], check=True)
    header, _, body = Path("back.ply").read_bytes().partition(b"end_header\n")
    columns = [line.split()[-1].decode() for line in header.splitlines() if line.startswith(b"property")]
    first = dict(zip(columns, np.frombuffer(body, "<f4")))
    read = np.array([first[name] for name in rest])
    right = int(np.isclose(read, written, atol=0.05).sum())
    shown = [0, 1, coefficients, 2 * coefficients]
    before = " ".join(f"f_rest_{index} {written[index]:.2f}" for index in shown)
    print(f"degree {degree}: right {right} of {len(rest)}; written {before}, read", *(f"{read[index]:.2f}" for index in shown))
    as_described &= np.allclose(read, written.reshape(-1, 3).T.ravel(), atol=0.05)
sys.exit(not as_described)
PY

#!/usr/bin/env bash
# pye57 and trimesh keep the low byte of colours of 16 bits.
#
# One would expect: colours in 16 bits, as LAS has them by its standard and a PLY of ushort by its type, to be scaled to the 8
#   bits that these libraries store, or to be refused.
# What happens: the number is cut to its low byte. LAS makes 16 bits of 8 by a factor of 256, so all of its colours become black
#   in an E57; where the factor was 257, they come out right by chance. Colours that have 16 bits from a camera become noise.
#   three.js keeps the 16 bits of the same PLY.
# Packages: pye57 0.4.19, trimesh 5.2.0 and laspy 2.7.0 (PyPI), three 0.187.0 (npm). Date: 2026-11-30.
# Why it matters: the points that start a training have wrong colours, or none. Noise of this kind looks like bad photographs.
#   Divide by 256, or by the largest value, before.
# Output seen (greys 0, 64, 128 and 255 of 8 bits, times the factor):
#   times 256: pye57 0 0 0 0, trimesh 0 0 0 0, three.js in 8 bits 0 64 128 254
#   times 257: pye57 0 64 128 255, trimesh 0 64 128 255, three.js in 8 bits 0 64 128 255
#   times 250: pye57 0 128 0 6, trimesh 0 128 0 6, three.js in 8 bits 0 62 125 248
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund three@0.187.0 >>npm.log
python3 -m venv tools
tools/bin/pip install --quiet pye57==0.4.19 trimesh==5.2.0 laspy==2.7.0 numpy 2>pip.log
cat >read.mjs <<'JS'
import { Color } from "three";
import { PLYLoader } from "three/examples/jsm/loaders/PLYLoader.js";
import fs from "fs";
const colour = new PLYLoader().parse(new Uint8Array(fs.readFileSync("points.ply")).buffer).getAttribute("color");
const greys = Array.from({ length: colour.count }, (_, row) => new Color(colour.getX(row), 0, 0).convertLinearToSRGB().r);
console.log(greys.map((grey) => Math.round(255 * grey)).join(" "));
JS
tools/bin/python - <<'PY'
import subprocess
import sys
from pathlib import Path

import laspy
import numpy as np
import pye57
import trimesh

GREYS = np.array([0, 64, 128, 255])
places = np.arange(12.0).reshape(4, 3)
as_described = True
for factor in (256, 257, 250):
    las = laspy.LasData(laspy.LasHeader(point_format=2))
    las.xyz = places
    las.red = las.green = las.blue = (GREYS * factor).astype(np.uint16)
    columns = {"cartesianX": places[:, 0].copy(), "cartesianY": places[:, 1].copy(), "cartesianZ": places[:, 2].copy()}
    file = pye57.E57("points.e57", mode="w")
    file.write_scan_raw({**columns, **{f"color{name}": np.asarray(las[name.lower()]) for name in ("Red", "Green", "Blue")}})
    file.close()
    from_e57 = pye57.E57("points.e57").read_scan(0, colors=True, ignore_missing_fields=True)["colorRed"].tolist()

    head = ["ply", "format binary_little_endian 1.0", "element vertex 4"]
    head += [*(f"property float {axis}" for axis in "xyz"), *(f"property ushort {name}" for name in ("red", "green", "blue"))]
    rows = np.zeros(4, [("place", "<f4", 3), ("colour", "<u2", 3)])
    rows["place"], rows["colour"] = places, np.stack([las.red, las.green, las.blue], axis=1)
    Path("points.ply").write_bytes("\n".join([*head, "end_header", ""]).encode() + rows.tobytes())
    from_ply = trimesh.load("points.ply").colors[:, 0].tolist()
    three = subprocess.run(["node", "read.mjs"], check=True, capture_output=True, text=True).stdout.strip()
    say = lambda numbers: " ".join(map(str, numbers))
    print(f"times {factor}: pye57 {say(from_e57)}, trimesh {say(from_ply)}, three.js in 8 bits {three}")
    as_described &= from_e57 == from_ply == (GREYS * factor % 256).tolist()
    as_described &= np.allclose(np.array(three.split(), float), GREYS * factor / 65535 * 255, atol=1.1)
sys.exit(not as_described)
PY

#!/usr/bin/env bash
# A Gaussian farther out than 2,048 lands on the other side of the scene in SPZ files of most writers.
#
# One would expect: a position that 24 bits cannot hold at 12 bits of fraction is written with fewer of these, as the
#   header has a field for their number, or is refused, or set to the nearest that can be written.
# What happens: SPZ's own library, splat-transform and gaussforge always take 12 bits of fraction and drop what lies above
#   bit 24: 2100 is read as -1996, and -3000 as 1096. gsply sets it to 2048. Nothing is said, whatever is lost.
# Packages: @adobe/spz 0.2.3 and @playcanvas/splat-transform 3.7.0 (npm), gaussforge 0.6.0 and gsply 0.4.6 (PyPI).
#   Date: 2026-11-29.
# Why it matters: skies of trained scenes lie that far out, and scenes in millimetres or national grids do altogether. What
#   was behind everything stands in the middle of it. Compare bounds after a conversion; subtract an origin before.
# Output seen:
#   written x 2000 2100 -3000
#   @adobe/spz: 12 bits of fraction, x 2000 -1996 1096
#   splat-transform: 12 bits of fraction, x 2000 -1996 1096
#   gaussforge: 12 bits of fraction, x 2000 -1996 1096
#   gsply: 12 bits of fraction, x 2000 2048 -2048
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @adobe/spz@0.2.3 @playcanvas/splat-transform@3.7.0 >>npm.log
python3 -m venv tools
tools/bin/pip install --quiet gaussforge==0.6.0 gsply==0.4.6 2>pip.log
tools/bin/python - <<'PY'
from pathlib import Path

import gsply
import numpy as np
from gaussforge import GaussForge

NAMES = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split()
rows = np.zeros((3, len(NAMES)), "<f4")
rows[:, 0] = 2000, 2100, -3000
rows[:, 6:] = [1, -3, -3, -3, 1, 0, 0, 0]
head = ["ply", "format binary_little_endian 1.0", "element vertex 3", *(f"property float {name}" for name in NAMES)]
ply = "\n".join([*head, "end_header", ""]).encode() + rows.tobytes()
Path("far.ply").write_bytes(ply)
Path("gaussforge.spz").write_bytes(GaussForge().convert(ply, "ply", "spz")["data"])
gsply.write_spz("gsply.spz", gsply.plyread("far.ply"))
PY
npx splat-transform -w far.ply splat-transform.spz --spz-version 3 >transform.log 2>&1
if grep --ignore-case warn transform.log; then exit 1; fi
cat >write.mjs <<'JS'
import fs from "node:fs";
import init from "@adobe/spz";

const spz = await init();
const positions = new Float32Array([2000, 0, 0, 2100, 0, 0, -3000, 0, 0]);
const rotations = new Float32Array([0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1]);
const [scales, colors] = [new Float32Array(9).fill(-3), new Float32Array(9)];
const cloud = { numPoints: 3, shDegree: 0, antialiased: false, extensions: [], positions, scales, rotations, colors };
Object.assign(cloud, { alphas: new Float32Array(3).fill(1), sh: new Float32Array(0) });
const options = { version: 3, sh1Bits: 5, shRestBits: 4, from: spz.CoordinateSystem.RUB };
fs.writeFileSync("adobe.spz", spz.saveSpzToBuffer(cloud, options));
JS
node write.mjs >adobe.log
tools/bin/python - <<'PY'
import gzip
import sys

import numpy as np

EXPECTED = {"adobe": [2000, -1996, 1096], "splat-transform": [2000, -1996, 1096], "gaussforge": [2000, -1996, 1096]}
EXPECTED["gsply"] = [2000, 2048, -2048]
print("written x 2000 2100 -3000")
seen = {}
for name in EXPECTED:
    content = gzip.decompress(open(f"{name}.spz", "rb").read())
    parts = np.frombuffer(content, np.uint8, 27, 16).reshape(3, 3, 3)[:, 0].astype(int) @ [1, 1 << 8, 1 << 16]
    x = np.where(parts < 1 << 23, parts, parts - (1 << 24)) / 2.0 ** content[13]
    seen[name] = [round(float(value)) for value in x]
    print(f"{name.replace('adobe', '@adobe/spz')}: {content[13]} bits of fraction, x", *seen[name])
sys.exit(seen != EXPECTED)
PY

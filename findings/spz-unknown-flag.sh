#!/usr/bin/env bash
# Readers of SPZ ignore flags that they do not know, and draw Spark's tree as a scene of half the opacity.
#
# One would expect: a file with an unknown bit in its flags is refused, or at least warned of.
# What happens: Spark writes trees of levels of detail with flag 0x80: parents beside their children, alpha bytes of
#   half the opacity. splat-transform, gsply and SPZ's library read all nodes as Gaussians, of half the opacity, and
#   say nothing.
# Packages: @adobe/spz 0.2.3 and @playcanvas/splat-transform 3.7.0 (npm), gsply 0.4.6 (PyPI). Date: 2026-11-27.
# Why it matters: the scene looks grey and coarse, and nothing tells why. Readers should refuse unknown bits by name.
# Output seen (a parent and four leaves of alpha 0.9):
#   @adobe/spz: 5 Gaussians, alpha 0.45
#   splat-transform: 5 Gaussians, alpha 0.45
#   gsply: 5 Gaussians, alpha 0.45
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @adobe/spz@0.2.3 @playcanvas/splat-transform@3.7.0 >>npm.log
python3 -m venv tools
tools/bin/pip install --quiet gsply==0.4.6 2>pip.log
tools/bin/python - <<'PY'
import gzip, struct
count = 5
head = struct.pack("<4sIIBBBB", b"NGSP", 3, count, 0, 12, 0x80, 0)
body = bytes(9 * count) + bytes([115] * count) + bytes([128] * 3 * count) + bytes([96] * 3 * count)
tree = struct.pack("<5H5I", 4, 0, 0, 0, 0, 1, 0, 0, 0, 0)
open("tree.spz", "wb").write(gzip.compress(head + body + struct.pack("<I", 3 << 30) * count + tree))
PY
cat >read.mjs <<'JS'
import init from "@adobe/spz";
import fs from "fs";
const spz = await init();
const cloud = spz.loadSpzFromBuffer(new Uint8Array(fs.readFileSync("tree.spz")), { to: spz.CoordinateSystem.RUB });
const alpha = 1 / (1 + Math.exp(-cloud.alphas[4]));
console.log(`@adobe/spz: ${cloud.numPoints} Gaussians, alpha ${alpha.toFixed(2)}`);
JS
{
  node read.mjs | grep adobe
  npx splat-transform -q -w tree.spz tree.csv
  tools/bin/python - <<'PY'
import csv, math
from gsply import read_spz
rows = list(csv.DictReader(open("tree.csv")))
say = lambda tool, logits: print(f"{tool}: {len(logits)} Gaussians, alpha {1 / (1 + math.exp(-logits[4])):.2f}")
say("splat-transform", [float(row["opacity"]) for row in rows])
say("gsply", read_spz("tree.spz").opacities)
PY
} | tee seen
test "$(grep -c '5 Gaussians, alpha 0.45' seen)" = 3

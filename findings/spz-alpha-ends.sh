#!/usr/bin/env bash
# The alpha bytes 0 and 255 of an SPZ file are other opacities in each reader.
#
# One would expect: one logit for each byte, as the format has one table; finite, so that a PLY made of it can be drawn.
# What happens: SPZ's own library gives -Infinity and Infinity, splat-transform -13.8 and 13.8, gsply -13.8 and 13.802.
#   A PLY made with the library then holds infinite logits, whose rows many loaders drop: the most opaque ones go.
# Packages: @adobe/spz 0.2.3 and @playcanvas/splat-transform 3.7.0 (npm), gsply 0.4.6 (PyPI). Date: 2026-11-27.
# Why it matters: converters chain. Keep infinite logits as opaque and transparent, and write finite ones.
# Output seen:
#   @adobe/spz: -Infinity Infinity
#   splat-transform: -13.8155 13.8155
#   gsply: -13.8155 13.8023
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
count = 2
head = struct.pack("<4sIIBBBB", b"NGSP", 3, count, 0, 12, 0, 0)
body = bytes(9 * count) + bytes([0, 255]) + bytes([128] * 3 * count) + bytes([96] * 3 * count)
open("two.spz", "wb").write(gzip.compress(head + body + struct.pack("<I", 3 << 30) * count))
PY
cat >read.mjs <<'JS'
import init from "@adobe/spz";
import fs from "fs";
const spz = await init();
const cloud = spz.loadSpzFromBuffer(new Uint8Array(fs.readFileSync("two.spz")), { to: spz.CoordinateSystem.RUB });
console.log(`@adobe/spz: ${[...cloud.alphas].join(" ")}`);
JS
{
  node read.mjs | grep adobe
  npx splat-transform -q -w two.spz two.csv
  tools/bin/python - <<'PY'
import csv
from gsply import read_spz
rows = list(csv.DictReader(open("two.csv")))
print("splat-transform:", *(f"{float(row['opacity']):.4f}" for row in rows))
print("gsply:", *(f"{logit:.4f}" for logit in read_spz("two.spz").opacities))
PY
} | tee seen
diff seen - <<'END'
@adobe/spz: -Infinity Infinity
splat-transform: -13.8155 13.8155
gsply: -13.8155 13.8023
END

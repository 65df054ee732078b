#!/usr/bin/env bash
# gsply calls every SPZ of version 1 too small, though it accepts the version.
#
# One would expect: a reader that lets version 1 pass its check of versions to read it: positions are three float16,
#   6 bytes for each Gaussian, as the README of SPZ says.
# What happens: it counts 9 bytes, those of version 2, and refuses the file as cut short by 3 bytes for each Gaussian.
#   @adobe/spz, which is SPZ's own library, and Spark read the file; splat-transform refuses the version by its name.
# Packages: gsply 0.4.6 (PyPI), @adobe/spz 0.2.3 and @playcanvas/splat-transform 3.7.0 (npm). Date: 2026-11-28.
# Why it matters: a whole file looks damaged, and one would get it again, or blame its writer.
# Output seen:
#   gsply, version 1: SPZ payload too small: have 80 need 95 (v1, N=5, sh_dim=0)
#   gsply, version 2: 5 Gaussians, the first at x = 0.5
#   @adobe/spz, version 1: 5 Gaussians, the first at x = 0.5
#   splat-transform, version 1: Unsupported .spz version 1
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @adobe/spz@0.2.3 @playcanvas/splat-transform@3.7.0 >>npm.log
python3 -m venv tools
tools/bin/pip install --quiet gsply==0.4.6 2>pip.log
tools/bin/python - <<'PY'
import gzip
import struct
import sys

import numpy as np
from gsply import read_spz

COUNT = 5
others = bytes([200] * COUNT + [128] * 3 * COUNT + [100] * 3 * COUNT + [128] * 3 * COUNT)
places = np.full((COUNT, 3), 0.5)
fixed = (places * 4096).astype("<i4").view(np.uint8).reshape(COUNT, 3, 4)[..., :3].tobytes()
for version, positions in ((1, places.astype("<f2").tobytes()), (2, fixed)):
    head = struct.pack("<4sIIBBBB", b"NGSP", version, COUNT, 0, 12, 0, 0)
    open(f"v{version}.spz", "wb").write(gzip.compress(head + positions + others))
try:
    read_spz("v1.spz")
    said = "read"
except ValueError as error:
    said = str(error).rpartition(":")[0]
print(f"gsply, version 1: {said}")
second = read_spz("v2.spz")
print(f"gsply, version 2: {len(second.means)} Gaussians, the first at x = {second.means[0, 0]:g}")
sys.exit("too small: have 80 need 95 (v1" not in said or float(second.means[0, 0]) != 0.5)
PY
cat >read.mjs <<'JS'
import fs from "node:fs";
import init from "@adobe/spz";
console.log = () => {};
const spz = await init();
const cloud = spz.loadSpzFromBuffer(new Uint8Array(fs.readFileSync("v1.spz")), { to: spz.CoordinateSystem.RUB });
process.stderr.write(`@adobe/spz, version 1: ${cloud.numPoints} Gaussians, the first at x = ${cloud.positions[0]}\n`);
process.exit(cloud.numPoints === 5 && cloud.positions[0] === 0.5 ? 0 : 1);
JS
node read.mjs 2>&1
if npx splat-transform -q -w v1.spz v1.csv >transform.log 2>&1; then exit 1; fi
echo "splat-transform, version 1: $(grep --only-matching 'Unsupported .spz version 1' transform.log)"

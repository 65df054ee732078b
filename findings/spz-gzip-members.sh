#!/usr/bin/env bash
# An SPZ of several gzip members is whole for some readers, empty or damaged for others.
#
# One would expect: RFC 1952 lets a gzip file be members one after the other, and gzip, zlib's gzread, Python and Node read
#   them as one. Writers that append, and bgzip, make such files. So readers of SPZ, gzip by its README, read them.
# What happens: gsply and splat-transform do. SPZ's own library stops after the first member, prints an error and returns a
#   cloud of no Gaussians, without raising one. three.js raises "Invalid SPZ byte length".
# Packages: @adobe/spz 0.2.3, @playcanvas/splat-transform 3.7.0 and three 0.187.0 (npm), gsply 0.4.6 (PyPI). Date: 2026-11-28.
# Why it matters: the header is in the first member, so sniffing succeeds, and an empty scene is taken for a read one. Write
#   one member; read all, and check the number of Gaussians against the header.
# Output seen:
#   @adobe/spz: 0 Gaussians of 3
#   three: THREE.SPZLoader: Invalid SPZ byte length.
#   splat-transform: 3 Gaussians of 3
#   gsply: 3 Gaussians of 3
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @adobe/spz@0.2.3 @playcanvas/splat-transform@3.7.0 three@0.187.0 >>npm.log
python3 -m venv tools
tools/bin/pip install --quiet gsply==0.4.6 2>pip.log
tools/bin/python - <<'PY'
import gzip, struct
count = 3
head = struct.pack("<4sIIBBBB", b"NGSP", 3, count, 0, 12, 0, 0)
body = bytes(9 * count) + bytes([128] * count) + bytes([128] * 3 * count) + bytes([96] * 3 * count)
whole = head + body + struct.pack("<I", 3 << 30) * count
open("three.spz", "wb").write(gzip.compress(whole[:30]) + gzip.compress(whole[30:]))
PY
cat >read.mjs <<'JS'
import init from "@adobe/spz";
import fs from "node:fs";
import { SPZLoader } from "three/addons/loaders/SPZLoader.js";

const file = new Uint8Array(fs.readFileSync("three.spz"));
const spz = await init();
const cloud = spz.loadSpzFromBuffer(file, { to: spz.CoordinateSystem.RUB });
console.log(`@adobe/spz: ${cloud.numPoints} Gaussians of 3`);
try {
  const geometry = await new SPZLoader().parse(file.slice().buffer);
  console.log(`three: ${geometry.attributes.position.count} Gaussians of 3`);
} catch (error) {
  console.log(`three: ${error.message}`);
}
JS
{
  node read.mjs 2>/dev/null | grep "^@adobe\|^three"
  npx splat-transform -q -w three.spz three.csv
  echo "splat-transform: $(($(wc -l <three.csv) - 1)) Gaussians of 3"
  tools/bin/python -c 'from gsply import read_spz; print("gsply:", len(read_spz("three.spz")), "Gaussians of 3")'
} | tee seen
diff seen - <<'END'
@adobe/spz: 0 Gaussians of 3
three: THREE.SPZLoader: Invalid SPZ byte length.
splat-transform: 3 Gaussians of 3
gsply: 3 Gaussians of 3
END

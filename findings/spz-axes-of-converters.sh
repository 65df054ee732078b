#!/usr/bin/env bash
# Converters write the axes of a PLY into SPZ as they are; SPZ's library turns them by half a turn about x.
#
# One would expect: a PLY of INRIA's axes (x right, y down, z forward), converted to SPZ, which stores x right, y up, z
#   back, comes back from SPZ's library, asked for RDF, as it was.
# What happens: splat-transform writes and reads y and z of SPZ unchanged, as gsply reads them, and the library's reader
#   negates both: the same file is upside down in one of two viewers. In glTF splat-transform does turn the axes.
# Packages: @adobe/spz 0.2.3 and @playcanvas/splat-transform 3.7.0 (npm), gsply 0.4.6 (PyPI). Date: 2026-11-27.
# Why it matters: an SPZ file does not tell which of the two wrote it; importers need an option, or the user's eye.
# Output seen:
#   splat-transform 1,2,3 gsply 1,2,3 library 1,-2,-3 glTF -1,-2,3
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @adobe/spz@0.2.3 @playcanvas/splat-transform@3.7.0 >>npm.log
python3 -m venv tools
tools/bin/pip install --quiet gsply==0.4.6 2>pip.log
tools/bin/python - <<'PY'
import struct
names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"]
names += [f"rot_{i}" for i in range(4)]
lines = ["ply", "format binary_little_endian 1.0", "element vertex 1", *(f"property float {name}" for name in names)]
row = struct.pack("<14f", 1, 2, 3, 0, 0, 0, 1, -3, -3, -3, 1, 0, 0, 0)
open("one.ply", "wb").write("\n".join([*lines, "end_header\n"]).encode() + row)
PY
npx splat-transform -q -w one.ply one.spz --spz-version 3
npx splat-transform -q -w one.spz one.csv
npx splat-transform -q -w one.ply one.glb
cat >read.mjs <<'JS'
import init from "@adobe/spz";
import fs from "fs";
const spz = await init();
const cloud = spz.loadSpzFromBuffer(new Uint8Array(fs.readFileSync("one.spz")), { to: spz.CoordinateSystem.RDF });
console.log("library", [...cloud.positions].map(Math.round).join(","));
JS
library=$(node read.mjs | grep library)
LIBRARY=$library tools/bin/python - <<'PY' | tee seen
import csv, json, os, struct
from gsply import read_spz
say = lambda numbers: ",".join(str(round(float(number))) for number in numbers)
row = next(csv.DictReader(open("one.csv")))
data = open("one.glb", "rb").read()
length = struct.unpack_from("<I", data, 12)[0]
document = json.loads(data[20 : 20 + length])
accessor = document["accessors"][document["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]
view = document["bufferViews"][accessor["bufferView"]]
at = 28 + length + view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
print("splat-transform", say(row[axis] for axis in "xyz"), "gsply", say(read_spz("one.spz").means[0]),
      os.environ["LIBRARY"], "glTF", say(struct.unpack_from("<3f", data, at)))
PY
grep -qx "splat-transform 1,2,3 gsply 1,2,3 library 1,-2,-3 glTF -1,-2,3" seen

#!/usr/bin/env bash
# DracoPy writes whole-numbered positions of point clouds as the bits of floats, and leaves their normals out.
#
# One would expect: positions of integers, as quantised ones are, to be kept exactly, to be turned into floats, or to be refused;
#   and normals and texture coordinates, which are arguments of encode, to be in the file of a point cloud as in that of a mesh.
# What happens: without faces, integers are made floats, and the bits of these are then written as integers: 1 becomes 1065353216. So
#   it is for lists of whole numbers, too. The order of numbers stays and their distances become logarithmic, so a viewer that
#   fits the view shows a bent cloud. Colours are kept; normals and texture coordinates are dropped. Nothing is said.
#   With faces all is right.
# Packages: DracoPy 2.2.0 (PyPI) and draco3d 1.5.9 (npm). Date: 2026-11-30.
# Why it matters: clouds in millimetres and voxel grids have whole coordinates, and integers are Draco's way to lose nothing. Surfels
#   and start points of a training need normals. Give floats, and normals of a cloud as a generic attribute.
# Output seen (first point, and all attributes that Draco's own decoder finds):
#   floats 1 2 3: 1 2 3
#   integers 1 2 3: 1065353216 1073741824 1077936128
#   a list 1 2 3: 1065353216 1073741824 1077936128
#   integers 1 2 3 of a mesh: 1 2 3
#   cloud: POSITION, COLOR
#   mesh: POSITION, NORMAL, COLOR, TEX_COORD
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet DracoPy==2.2.0 numpy 2>pip.log
npm init --yes >npm.log
npm install --silent --no-audit --no-fund draco3d@1.5.9 >>npm.log
tools/bin/python - <<'PY'
from pathlib import Path

import DracoPy
import numpy as np

whole = np.array([[1, 2, 3], [4, 5, 6], [7, 8, 10]])
faces = np.array([[0, 1, 2]], np.uint32)
others = {
    "normals": np.eye(3),
    "tex_coord": np.eye(3)[:, :2].copy(),
    "colors": np.full((3, 3), 200, np.uint8),
}
for name, data in {
    "floats 1 2 3": DracoPy.encode(whole.astype(np.float32), quantization_bits=20, preserve_order=True),
    "integers 1 2 3": DracoPy.encode(whole, preserve_order=True),
    "a list 1 2 3": DracoPy.encode(whole.tolist(), preserve_order=True),
    "integers 1 2 3 of a mesh": DracoPy.encode(whole, faces, preserve_order=True),
    "cloud": DracoPy.encode(whole.astype(np.float32), preserve_order=True, **others),
    "mesh": DracoPy.encode(whole.astype(np.float32), faces, preserve_order=True, **others),
}.items():
    Path(f"{name}.drc").write_bytes(data)
PY
cat >read.cjs <<'JS'
const { readFileSync } = require("node:fs");
const draco = require("draco3d");

const KINDS = ["POSITION", "NORMAL", "COLOR", "TEX_COORD"];
draco.createDecoderModule({}).then((module) => {
  for (const name of process.argv.slice(2)) {
    const bytes = new Int8Array(readFileSync(`${name}.drc`));
    const decoder = new module.Decoder();
    const isMesh = decoder.GetEncodedGeometryType(bytes) === module.TRIANGULAR_MESH;
    const cloud = isMesh ? new module.Mesh() : new module.PointCloud();
    const status = isMesh ? decoder.DecodeArrayToMesh(bytes, bytes.length, cloud) : decoder.DecodeArrayToPointCloud(bytes, bytes.length, cloud);
    if (!status.ok()) throw new Error(status.error_msg());
    const kinds = Array.from({ length: cloud.num_attributes() }, (_, index) => decoder.GetAttribute(cloud, index).attribute_type());
    const numbers = new module.DracoFloat32Array();
    decoder.GetAttributeFloatForAllPoints(cloud, decoder.GetAttribute(cloud, kinds.indexOf(0)), numbers);
    const first = [0, 1, 2].map((index) => Math.round(100 * numbers.GetValue(index)) / 100).join(" ");
    console.log(`${name}: ${/\d/.test(name) ? first : kinds.sort().map((kind) => KINDS[kind]).join(", ")}`);
  }
});
JS
node read.cjs "floats 1 2 3" "integers 1 2 3" "a list 1 2 3" "integers 1 2 3 of a mesh" cloud mesh | tee seen
diff seen - <<'END'
floats 1 2 3: 1 2 3
integers 1 2 3: 1065353216 1073741824 1077936128
a list 1 2 3: 1065353216 1073741824 1077936128
integers 1 2 3 of a mesh: 1 2 3
cloud: POSITION, COLOR
mesh: POSITION, NORMAL, COLOR, TEX_COORD
END

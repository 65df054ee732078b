#!/usr/bin/env bash
# A point cloud is brighter as trimesh's GLB than as the PLY that it was made of, in the same viewer.
#
# One would expect: a conversion to keep how colours look. Bytes of a PLY are sRGB, as in a photograph; glTF's COLOR_0 is
#   linear.
# What happens: trimesh copies the bytes. three.js takes each format as it is meant, so that the PLY's grey of 64 is shown as
#   64, the GLB's as 137. (It keeps a PLY's linear colours in bytes, so that 16 becomes 13.) Back from GLB to PLY, trimesh
#   copies again, so that its own round trip looks right; the PLY of a GLB by others is too dark.
# Packages: trimesh 5.2.0 (PyPI) and three 0.187.0 (npm). Date: 2026-11-30.
# Why it matters: clouds and meshes beside Gaussians look washed out, which passes for exposure, and a training that starts from
#   colours of a GLB starts from other ones. Make colours linear before the export, in 16 bits or floats.
# Output seen (greys of the PLY, then as a viewer shows them):
#   0 16 64 128 200 255: PLY 0 13 64 128 200 255, GLB 0 71 137 188 229 255
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund three@0.187.0 >>npm.log
python3 -m venv tools
tools/bin/pip install --quiet trimesh==5.2.0 numpy 2>pip.log
tools/bin/python - <<'PY'
import numpy as np
import trimesh

greys = np.array([0, 16, 64, 128, 200, 255], np.uint8)
colours = np.stack([greys, greys, greys, np.full(6, 255, np.uint8)], axis=1)
trimesh.PointCloud(np.arange(18.0).reshape(6, 3), colors=colours).export("points.ply")
trimesh.load("points.ply").export("points.glb")
PY
cat >read.mjs <<'JS'
import { Color } from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";
import { PLYLoader } from "three/examples/jsm/loaders/PLYLoader.js";
import fs from "fs";

globalThis.self = globalThis;
const read = (name) => new Uint8Array(fs.readFileSync(name)).buffer;
// What is in the buffers is linear for three.js; what a screen shows is sRGB.
const show = (colour) => {
  const greys = Array.from({ length: colour.count }, (_, row) => new Color(colour.getX(row), 0, 0).convertLinearToSRGB().r);
  return greys.map((grey) => Math.round(255 * grey)).join(" ");
};
const ply = new PLYLoader().parse(read("points.ply"));
const gltf = await new GLTFLoader().parseAsync(read("points.glb"), "");
let points;
gltf.scene.traverse((thing) => { if (thing.isPoints) points = thing; });
console.log(`0 16 64 128 200 255: PLY ${show(ply.attributes.color)}, GLB ${show(points.geometry.attributes.color)}`);
JS
node read.mjs | tee seen
grep -qx "0 16 64 128 200 255: PLY 0 13 64 128 200 255, GLB 0 71 137 188 229 255" seen

#!/usr/bin/env bash
# glTF Transform keeps every attribute of Gaussians, and drops the extension that says that they are some.
#
# One would expect: a program that rewrites a glTF keeps an extension that it does not know, as pygltflib does, or refuses
#   the file, or drops what belongs to the extension with it.
# What happens: reading and writing again, without any change, removes KHR_gaussian_splatting from the primitive and from
#   extensionsUsed. All its attributes, such as KHR_gaussian_splatting:SCALE, stay, and so does the size of the file. A
#   line in the log says "Missing optional extension".
# Packages: @gltf-transform/core and @gltf-transform/extensions 4.5.1 (npm), pygltflib 1.16.5 (PyPI). Date: 2026-11-28.
# Why it matters: it is the usual step of pipelines for the web (prune, merge, add metadata). The result is a valid file
#   that viewers show as points; kernel and colour space cannot be had again. Keep splats in a file of their own.
# Output seen:
#   glTF Transform: extensions undefined, attributes POSITION and 4 of KHR_gaussian_splatting
#   pygltflib: extensions {'KHR_gaussian_splatting': {'kernel': 'ellipse', 'colorSpace': 'srgb_rec709_display'}}
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @gltf-transform/core@4.5.1 @gltf-transform/extensions@4.5.1 >>npm.log
python3 -m venv tools
tools/bin/pip install --quiet pygltflib==1.16.5 2>pip.log
cat >rewrite.mjs <<'JS'
import { Logger, NodeIO } from "@gltf-transform/core";
import { ALL_EXTENSIONS } from "@gltf-transform/extensions";
import fs from "node:fs";

const SPLAT = "KHR_gaussian_splatting";
const WIDTHS = { POSITION: 3, [`${SPLAT}:ROTATION`]: 4, [`${SPLAT}:SCALE`]: 3, [`${SPLAT}:OPACITY`]: 1 };
WIDTHS[`${SPLAT}:SH_DEGREE_0_COEF_0`] = 3;
let bytes = 0;
const bufferViews = [], accessors = [], attributes = {}, values = [];
for (const [name, width] of Object.entries(WIDTHS)) {
  attributes[name] = accessors.length;
  accessors.push({ bufferView: bufferViews.length, componentType: 5126, count: 1, type: width === 1 ? "SCALAR" : `VEC${width}` });
  if (name === "POSITION") Object.assign(accessors[0], { min: [1, 0, 0], max: [1, 0, 0] });
  bufferViews.push({ buffer: 0, byteOffset: bytes, byteLength: 4 * width });
  values.push(1, ...Array(width - 1).fill(0));
  bytes += 4 * width;
}
const uri = "data:application/octet-stream;base64," + Buffer.from(new Float32Array(values).buffer).toString("base64");
const extensions = { [SPLAT]: { kernel: "ellipse", colorSpace: "srgb_rec709_display" } };
const document = {
  asset: { version: "2.0" }, extensionsUsed: [SPLAT], scene: 0, scenes: [{ nodes: [0] }], nodes: [{ mesh: 0 }],
  meshes: [{ primitives: [{ mode: 0, attributes, extensions }] }], buffers: [{ byteLength: bytes, uri }], bufferViews, accessors,
};
fs.writeFileSync("splats.gltf", JSON.stringify(document));
const io = new NodeIO().setLogger(new Logger(Logger.Verbosity.SILENT)).registerExtensions(ALL_EXTENSIONS);
const { json } = await io.writeJSON(await io.read("splats.gltf"));
const [primitive] = json.meshes[0].primitives;
const kept = Object.keys(primitive.attributes).filter((name) => name.startsWith(SPLAT)).length;
console.log(`glTF Transform: extensions ${primitive.extensions}, attributes POSITION and ${kept} of ${SPLAT}`);
process.exit(primitive.extensions === undefined && json.extensionsUsed === undefined && kept === 4 ? 0 : 1);
JS
node rewrite.mjs
tools/bin/python - <<'PY'
import json
import sys

from pygltflib import GLTF2

GLTF2().load("splats.gltf").save("again.gltf")
extensions = json.load(open("again.gltf"))["meshes"][0]["primitives"][0].get("extensions")
print("pygltflib: extensions", extensions)
sys.exit(extensions is None)
PY

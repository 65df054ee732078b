#!/usr/bin/env bash
# Spark shows a PLY of Gaussians as opaque dots if it has columns red, green and blue as well.
#
# One would expect: a PLY with all columns of Gaussians to be read as Gaussians; further columns are ignored.
# What happens: as soon as there are red, green and blue, Spark takes the file for a point cloud. Sizes, rotations,
#   opacities and harmonics are dropped without a word: every Gaussian is a dot of size 0.001 and opacity 1. Colours
#   come from the extra columns.
# Packages: @sparkjsdev/spark 2.2.0 (npm). Date: 2026-11-28.
# Why it matters: exporters add such columns so that point cloud viewers show colours, and Nerfstudio can write them in
#   place of f_dc. Such scenes look empty in Spark. Leave red, green and blue out of files meant for it.
# Output seen:
#   Gaussians: opacity 186 of 255, sizes 0.0504 0.1359 0.3664
#   with red, green and blue: opacity 255 of 255, sizes 0.0010 0.0010 0.0010
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund --legacy-peer-deps @sparkjsdev/spark@2.2.0 >>npm.log
cat >read.mjs <<'JS'
import fs from "node:fs";
import vm from "node:vm";
import { Worker } from "node:worker_threads";

// Spark decodes in a worker of the browser, whose code its module holds as text. Here it runs in a thread.
const text = fs.readFileSync("node_modules/@sparkjsdev/spark/dist/spark.module.js", "utf8");
const code = vm.runInNewContext(text.match(/^const jsContent = (.*);$/m)[1]);
const module = new WebAssembly.Module(Buffer.from(text.match(/decode64\("([\w+/=]{1000,})"/)[1], "base64"));
const browser = `
  const { parentPort } = require("node:worker_threads");
  const handlers = new Set();
  globalThis.self = globalThis;
  globalThis.postMessage = (message) => parentPort.postMessage(message);
  globalThis.addEventListener = (kind, handler) => handlers.add(handler);
  globalThis.removeEventListener = (kind, handler) => handlers.delete(handler);
  parentPort.on("message", (data) => [...handlers].forEach((handler) => handler({ data })));`;
const worker = new Worker(browser + code, { eval: true });
worker.postMessage({ name: "init-wasm", module });

const load = (id, fileBytes) =>
  new Promise((done, fail) => {
    worker.on("message", (reply) => reply.id === id && (reply.error ? fail(reply.error) : reply.result && done(reply.result)));
    worker.postMessage({ id, name: "loadPackedSplats", args: { fileBytes, fileType: "ply" } });
  });

const names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split(" ");
const gaussian = new Float32Array([0, 0, 0, 0, 0, 0, 1, -3, -2, -1, 1, 0, 0, 0]);
const ply = (colours) => {
  const columns = [...names.map((name) => `property float ${name}`), ...colours.map((name) => `property uchar ${name}`)];
  const head = ["ply", "format binary_little_endian 1.0", "element vertex 1", ...columns, "end_header", ""].join("\n");
  return new Uint8Array(Buffer.concat([Buffer.from(head), Buffer.from(gaussian.buffer), Buffer.alloc(colours.length, 128)]));
};

let asDescribed = true;
for (const [title, colours, opacity, sizes] of [
  ["Gaussians", [], 186, [-3, -2, -1].map(Math.exp)],
  ["with red, green and blue", ["red", "green", "blue"], 255, [0.001, 0.001, 0.001]],
]) {
  const { packedArray: words, splatEncoding } = await load(title, ply(colours));
  const { lnScaleMin: low, lnScaleMax: high } = { lnScaleMin: -12, lnScaleMax: 9, ...splatEncoding };
  const found = [0, 8, 16].map((shift) => Math.exp(low + ((((words[3] >>> shift) & 255) - 1) / 254) * (high - low)));
  console.log(`${title}: opacity ${words[0] >>> 24} of 255, sizes ${found.map((size) => size.toFixed(4)).join(" ")}`);
  asDescribed &&= words[0] >>> 24 === opacity && found.every((size, axis) => Math.abs(size / sizes[axis] - 1) < 0.05);
}
process.exit(asDescribed ? 0 : 1);
JS
node read.mjs

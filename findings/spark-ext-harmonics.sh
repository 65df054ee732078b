#!/usr/bin/env bash
# Spark's ExtSplats, the more exact of its two kinds of splats, cut harmonics to a power of two.
#
# One would expect: a coefficient of red, green and blue with a common exponent and 8 bits each keeps the largest of
#   them, to 1/255 of itself or to half of that.
# What happens: the exponent is that of the power of two below the largest, and that power is byte 255. What is larger
#   is cut: 0.3, 0.4 and 0.49 all become 0.25. Loading a file, the JavaScript helpers and the shaders agree in it.
#   PackedSplats, with 7 bits and a range for all splats, keep the values.
# Package: @sparkjsdev/spark 2.2.0 (npm). Date: 2026-11-28.
# Why it matters: with `extSplats: true` views from the side lose up to half of what depends on direction, in scenes of
#   every format. Compare renderers with PackedSplats, or against the file.
# Output seen:
#   stored 0.300 0.400 0.490: ExtSplats 0.250 0.250 0.250, PackedSplats 0.302 0.397 0.492
#   stored 0.510 0.750 0.990: ExtSplats 0.500 0.500 0.500, PackedSplats 0.508 0.746 0.984
#   stored -0.200 0.126 -0.125: ExtSplats -0.125 0.125 -0.125, PackedSplats -0.206 0.127 -0.127
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

const call = (name, args) =>
  new Promise((done, fail) => {
    worker.on("message", ({ id, result, error }) => id === name && (error ? fail(error) : result && done(result)));
    worker.postMessage({ id: name, name, args });
  });

// The first coefficient of degree 1, in red, green and blue, of three splats.
const STORED = [[0.3, 0.4, 0.49], [0.51, 0.75, 0.99], [-0.2, 0.126, -0.125]];
const rest = [...Array(9).keys()].map((index) => `f_rest_${index}`);
const others = "opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split(" ");
const columns = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", ...rest, ...others].map((name) => `property float ${name}`);
const head = ["ply", "format binary_little_endian 1.0", `element vertex ${STORED.length}`, ...columns, "end_header", ""];
const rows = STORED.flatMap(([red, green, blue]) => [
  ...[0, 0, 0, 0, 0, 0], ...[red, 0, 0, green, 0, 0, blue, 0, 0], ...[1, -3, -3, -3, 1, 0, 0, 0],
]);
const ply = () => new Uint8Array(Buffer.concat([Buffer.from(head.join("\n")), Buffer.from(new Float32Array(rows).buffer)]));

const sign = (word, c) => ((word >>> (24 + c)) & 1 ? -1 : 1);
const magnitude = (word, c) => (((word >>> (8 * c)) & 255) / 255) * 2 ** ((word >>> 27) - 15);
const fromExt = (word) => [0, 1, 2].map((c) => sign(word, c) * magnitude(word, c));
const fromPacked = (word) => [0, 1, 2].map((c) => ((word << (25 - 7 * c)) >> 25) / 63);
const ext = await call("loadExtSplats", { fileBytes: ply(), fileType: "ply" });
const packed = await call("loadPackedSplats", { fileBytes: ply(), fileType: "ply" });
const say = (values) => values.map((value) => value.toFixed(3)).join(" ");
const near = (values, others, step) => values.every((value, c) => Math.abs(value - others[c]) <= step);
let asDescribed = true;
STORED.forEach((stored, index) => {
  const exact = fromExt(ext.extra.sh1[4 * index]), coarse = fromPacked(packed.extra.sh1[2 * index]);
  const power = 2 ** Math.floor(Math.log2(Math.max(...stored.map(Math.abs))));
  const cut = stored.map((value) => Math.sign(value) * Math.min(Math.abs(value), power));
  console.log(`stored ${say(stored)}: ExtSplats ${say(exact)}, PackedSplats ${say(coarse)}`);
  asDescribed &&= near(exact, cut, power / 255) && near(coarse, stored, 0.5 / 63 + 1e-6);
});
process.exit(asDescribed ? 0 : 1);
JS
node read.mjs

#!/usr/bin/env bash
# GaussianSplats3D gives columns that a PLY lacks the values of the file that it read before.
#
# One would expect: a column that is not there, or of a type that is not read, to be refused, or to get one fixed value.
# What happens: the parser of PLY keeps one row of numbers for all files. What a file does not fill keeps the last
#   Gaussian of the file before. So a PLY without opacity has that Gaussian's opacity, and positions in doubles, which
#   are passed over, put every Gaussian at its place. After no file, opacity is 0 and positions are undefined.
# Package: @mkkellogg/gaussian-splats-3d 0.4.7 (npm). Date: 2026-11-28.
# Why it matters: the same file looks right, wrong or empty by what was opened before, so a fault cannot be repeated by
#   loading the file alone. Give this parser whole scenes of floats, and check columns before.
# Output seen:
#   without opacity: alone 0, after a file of opacity 0.9 229, after one of opacity 0.1 25
#   positions in doubles, x = 5: alone undefined, after a file with x = 7 7, after one with x = 8 8
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @mkkellogg/gaussian-splats-3d@0.4.7 three@0.187.0 >>npm.log
cat >read.mjs <<'JS'
import { execFileSync } from "node:child_process";

globalThis.window = globalThis.self = globalThis;
const element = () => ({ style: {}, getContext: () => null });
globalThis.document = { createElement: element, createElementNS: element };
const { PlyParser } = await import("@mkkellogg/gaussian-splats-3d");

const COUNT = 100;
const REST = "f_dc_0 f_dc_1 f_dc_2 scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split(" ");
const ply = (x, opacity, kind = "float") => {
  const named = [...["x", "y", "z"].map((name) => [kind, name, x]), ...REST.map((name) => ["float", name, 0.5])];
  if (opacity !== null) named.push(["float", "opacity", Math.log(opacity / (1 - opacity))]);
  const columns = named.map(([type, name]) => `property ${type} ${name}`);
  const head = Buffer.from(["ply", "format binary_little_endian 1.0", `element vertex ${COUNT}`, ...columns, "end_header", ""].join("\n"));
  const numbers = named.map(([type, , value]) => (type === "double" ? Float64Array : Float32Array).of(value));
  const row = Buffer.concat(numbers.map((one) => Buffer.from(one.buffer)));
  const whole = Buffer.concat([head, ...Array(COUNT).fill(row)]);
  return whole.buffer.slice(whole.byteOffset, whole.byteOffset + whole.length);
};
// Of a splat, 0 is x and 13 is the opacity, 0 to 255.
const read = (data, which) => PlyParser.parseToUncompressedSplatArray(data, 0).splats[0][which];
const cases = { opacity: [ply(0, null), 13], place: [ply(5, 0.5, "double"), 0] };
if (process.argv[2]) {
  console.log(String(read(...cases[process.argv[2]])));
  process.exit(0);
}
const alone = (name) => execFileSync("node", ["read.mjs", name], { stdio: ["ignore", "pipe", "inherit"] }).toString().trim();
const after = (name, before) => (read(before, 0), read(...cases[name]));
const opacity = [alone("opacity"), after("opacity", ply(0, 0.9)), after("opacity", ply(0, 0.1))];
const place = [alone("place"), after("place", ply(7, 0.5)), after("place", ply(8, 0.5))];
console.log(`without opacity: alone ${opacity[0]}, after a file of opacity 0.9 ${opacity[1]}, after one of opacity 0.1 ${opacity[2]}`);
console.log(`positions in doubles, x = 5: alone ${place[0]}, after a file with x = 7 ${place[1]}, after one with x = 8 ${place[2]}`);
process.exit(opacity[1] === 229 && opacity[2] === 25 && place[1] === 7 && place[2] === 8 ? 0 : 1);
JS
node read.mjs 2>node.log

#!/usr/bin/env bash
# splat-transform moves, turns and cuts a PLY with x and y the other way round, and its CSV shows none of the moves.
#
# One would expect: of a file converted from PLY to PLY, -t 10,0,0 adds 10 to x, and -V x,gt,0 keeps the rows whose x is
#   above 0; and a .csv has the numbers that a .ply of the same command has.
# What happens: actions count in the engine's space, which is the PLY's turned by half a turn about z, also where both files
#   are PLYs and the rows of the result have the file's axes again. So 10 is taken from x, and the boxes, spheres and
#   values of filters keep the opposite side. A .csv takes filters, and leaves moves, turns and sizes out.
# Package: @playcanvas/splat-transform 3.7.0 (npm). Date: 2026-11-29.
# Why it matters: bounds that were read from the file cut the wrong half away; two scenes moved together by a known offset
#   come apart by twice of it. Give x and y with the other sign, and look at results in a .ply.
# Output seen (x of two Gaussians, at -1 and 2 in the file):
#   -t 10,0,0: .ply -11, -8; .csv -1, 2
#   -s 2: .ply -2, 4; .csv -1, 2
#   -V x,gt,0: .ply -1; .csv -1
#   -B 0,-9,-9,9,9,9: .ply -1; .csv -1
#   -S 2,0,0,1: .ply none; .csv none
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @playcanvas/splat-transform@3.7.0 >>npm.log
cat >act.mjs <<'JS'
import { spawnSync } from "node:child_process";
import fs from "node:fs";

const names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split(" ");
const rows = new Float32Array([-1, 2].flatMap((x) => [x, 0, 0, 0, 0, 0, 1, -3, -3, -3, 1, 0, 0, 0]));
const head = (count, columns) =>
  ["ply", "format binary_little_endian 1.0", `element vertex ${count}`, ...columns, "end_header", ""].join("\n");
const columns = names.map((name) => `property float ${name}`);
fs.writeFileSync("in.ply", Buffer.concat([Buffer.from(head(2, columns)), Buffer.from(rows.buffer)]));

const fromPly = (bytes) => {
  const start = bytes.indexOf("end_header\n") + 11;
  const found = [...bytes.subarray(0, start).toString().matchAll(/property float (\w+)/g)].map((match) => match[1]);
  const step = 4 * found.length, at = start + 4 * found.indexOf("x");
  return [...Array((bytes.length - start) / step).keys()].map((row) => bytes.readFloatLE(at + row * step));
};
const fromCsv = (bytes) => {
  const [names, ...lines] = bytes.toString().trim().split("\n").map((line) => line.split(","));
  return lines.map((line) => Number(line[names.indexOf("x")]));
};
const run = (action, output, read) => {
  fs.rmSync(output, { force: true });
  spawnSync("npx", ["splat-transform", "-q", "in.ply", ...action.split(" "), output]);
  const x = fs.existsSync(output) ? read(fs.readFileSync(output)) : [];
  return x.length ? x.map((value) => Number(value.toFixed(3))).join(", ") : "none";
};
const expected = {
  "-t 10,0,0": ["-11, -8", "-1, 2"], "-s 2": ["-2, 4", "-1, 2"], "-V x,gt,0": ["-1", "-1"],
  "-B 0,-9,-9,9,9,9": ["-1", "-1"], "-S 2,0,0,1": ["none", "none"],
};
let asDescribed = true;
for (const [action, seen] of Object.entries(expected)) {
  const [ply, csv] = [run(action, "out.ply", fromPly), run(action, "out.csv", fromCsv)];
  console.log(`${action}: .ply ${ply}; .csv ${csv}`);
  asDescribed &&= ply === seen[0] && csv === seen[1];
}
process.exit(asDescribed ? 0 : 1);
JS
node act.mjs

#!/usr/bin/env bash
# splat-transform joins scenes of different degrees column by column: harmonics of the lower one change colour and lobe.
#
# One would expect: of scenes of degree 1 and 3, the Gaussians of the first keep their three coefficients of each colour,
#   and get zeros for those of degrees 2 and 3; or the lower degree is taken, or the join refused.
# What happens: columns are joined by name, and what a scene lacks is zero. But f_rest_3 is the first of green at degree 1
#   and the fourth of red at degree 3. So red takes all nine, green and blue have none. Nothing is said.
# Package: @playcanvas/splat-transform 3.7.0 (npm). Date: 2026-11-29.
# Why it matters: joining is what the tool is for: a sky or an object of a lower degree, or one cut by -H, beside a scene.
#   It turns red and green with the view, while the scene is right. Cut all files to the lowest degree by -H first.
# Output seen (harmonics of the Gaussian of degree 1; the first three of each colour after joining):
#   alone: red 0.1 0.2 0.3, green 0.4 0.5 0.6, blue 0.7 0.8 0.9
#   joined with degree 3: red 0.1 0.2 0.3, green 0 0 0, blue 0 0 0; red goes on 0.4 0.5 0.6 0.7 0.8 0.9
#   joined with degree 3 after -H 1: red 0.1 0.2 0.3, green 0.4 0.5 0.6, blue 0.7 0.8 0.9
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @playcanvas/splat-transform@3.7.0 >>npm.log
cat >join.mjs <<'JS'
import { execFileSync } from "node:child_process";
import fs from "node:fs";

const write = (file, x, rest) => {
  const names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", ...rest.map((_, index) => `f_rest_${index}`), "opacity"];
  names.push("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3");
  const columns = names.map((name) => `property float ${name}`);
  const head = ["ply", "format binary_little_endian 1.0", "element vertex 1", ...columns, "end_header", ""].join("\n");
  const row = new Float32Array([x, 0, 0, 0, 0, 0, ...rest, 1, -3, -3, -3, 1, 0, 0, 0]);
  fs.writeFileSync(file, Buffer.concat([Buffer.from(head), Buffer.from(row.buffer)]));
};
// The harmonics of the first Gaussian, the one at x = 1: red, green and blue.
const read = (file) => {
  const bytes = fs.readFileSync(file);
  const start = bytes.indexOf("end_header\n") + 11;
  const names = [...bytes.subarray(0, start).toString().matchAll(/property float (\w+)/g)].map((match) => match[1]);
  const rest = names.filter((name) => name.startsWith("f_rest_")).length;
  const value = (row, name) => bytes.readFloatLE(start + 4 * (row * names.length + names.indexOf(name)));
  const row = value(0, "x") === 1 ? 0 : 1;
  const values = [...Array(rest).keys()].map((index) => Number(value(row, `f_rest_${index}`).toFixed(3)));
  return [0, 1, 2].map((colour) => values.slice((colour * rest) / 3, ((colour + 1) * rest) / 3));
};
write("one.ply", 1, [1, 2, 3, 4, 5, 6, 7, 8, 9].map((value) => value / 10));
write("three.ply", 3, Array(45).fill(0.5));
execFileSync("npx", ["splat-transform", "-q", "one.ply", "three.ply", "joined.ply"]);
execFileSync("npx", ["splat-transform", "-q", "one.ply", "three.ply", "-H", "1", "cut.ply"]);
const tell = (title, colours) => {
  const parts = ["red", "green", "blue"].map((name, index) => `${name} ${colours[index].slice(0, 3).join(" ")}`);
  const further = colours[0].slice(3).filter((value) => value !== 0);
  console.log(`${title}: ${parts.join(", ")}${further.length ? `; red goes on ${further.join(" ")}` : ""}`);
};
const [alone, joined, cut] = ["one.ply", "joined.ply", "cut.ply"].map(read);
tell("alone", alone);
tell("joined with degree 3", joined);
tell("joined with degree 3 after -H 1", cut);
const moved = joined[0].slice(0, 9).join() === alone.flat().join() && joined.flat().slice(9).every((value) => value === 0);
process.exit(moved && cut.flat().join() === alone.flat().join() ? 0 : 1);
JS
node join.mjs

#!/usr/bin/env bash
# three.js cuts the colour of degree 0 to bytes before harmonics are added; the trained colour is cut after.
#
# One would expect: 0.5 + 0.282 f_dc + the other harmonics, and what is below 0 or above 1 of that sum is cut, as INRIA's
#   renderer and gsplat have it.
# What happens: GaussianSplatPLYLoader stores the colour of degree 0 in bytes, 0 to 1, and each other coefficient in bytes,
#   -1 to 1. A highlight of base 1.5 and harmonics of -0.5 from here is 0.5 instead of 1.
# Package: three 0.187.0 (npm). Date: 2026-11-28.
# Why it matters: trained scenes do hold colours beyond 0 to 1 (skies, lamps, deep shadows) that harmonics bring back. They
#   are dull in this renderer from a full PLY, not from a lossy file alone: compare renderers by values within 0 to 1.
# Output seen:
#   base -0.50: stored 0.00, harmonic 0.50: stored 0.50
#   base 0.50: stored 0.50, harmonic 1.50: stored 0.99
#   base 1.50: stored 1.00, harmonic -0.50: stored -0.50
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund three@0.187.0 >>npm.log
cat >read.mjs <<'JS'
import { GaussianSplatPLYLoader } from "three/addons/loaders/GaussianSplatPLYLoader.js";

const SH0 = 0.28209479177387814;
const BASE = [-0.5, 0.5, 1.5], HARMONIC = [0.5, 1.5, -0.5]; // of red, green and blue
const rest = [...Array(9).keys()].map((index) => `f_rest_${index}`);
const others = "opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split(" ");
const columns = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", ...rest, ...others].map((name) => `property float ${name}`);
const head = ["ply", "format binary_little_endian 1.0", "element vertex 1", ...columns, "end_header", ""].join("\n");
const row = [0, 0, 0, ...BASE.map((colour) => (colour - 0.5) / SH0), ...HARMONIC.flatMap((value) => [value, 0, 0])];
const body = new Float32Array([...row, 1, -3, -3, -3, 1, 0, 0, 0]);
const file = new Uint8Array(Buffer.concat([Buffer.from(head), Buffer.from(body.buffer)]));
const { color, sphericalHarmonics1 } = new GaussianSplatPLYLoader().parse(file.buffer).attributes;
const base = [...color.array.slice(0, 3)].map((byte) => byte / 255);
const words = sphericalHarmonics1.array;
const bytes = new Uint8Array(words.buffer, words.byteOffset, 3);
const harmonic = [...bytes].map((byte) => (byte - 128) / 128);
BASE.forEach((colour, c) => {
  console.log(`base ${colour.toFixed(2)}: stored ${base[c].toFixed(2)}, harmonic ${HARMONIC[c].toFixed(2)}: stored ${harmonic[c].toFixed(2)}`);
});
const near = (value, other) => Math.abs(value - other) < 0.01;
const cut = BASE.every((colour, c) => near(base[c], Math.min(Math.max(colour, 0), 1)));
process.exit(cut && HARMONIC.every((value, c) => near(harmonic[c], Math.min(value, 127 / 128))) ? 0 : 1);
JS
node read.mjs

#!/usr/bin/env bash
# Half of the rotated coordinate systems of SPZ's library are not what their letters say.
#
# One would expect: of a point at right 1, up 2, back 3 (RUB), LFD (left, front, down) has -1, -3, -2, and RBU 1, 3, 2.
# What happens: systems with F and D, or B and U, have the second and third coordinate negated: the library flips by
#   the bits of the number before it turns, when the axes still have other places. LFU, RFU, LBD and RBD are right.
# Package: @adobe/spz 0.2.3 (npm), the WebAssembly build of github.com/nianticlabs/spz. Date: 2026-11-27.
# Why it matters: a reader that goes by the letters of the extension SPZ_ADOBE_coordinate_system shows such files upside
#   down. Files of this library have to be read with the inverse of what it does.
# Output seen:
#   LFD -1,3,2 by its letters -1,-3,-2
#   RFD 1,3,2 by its letters 1,-3,-2
#   LBU -1,-3,-2 by its letters -1,3,2
#   RBU 1,-3,-2 by its letters 1,3,2
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @adobe/spz@0.2.3 >>npm.log
cat >axes.mjs <<'JS'
import init from "@adobe/spz";
const spz = await init();
const names = ["LFD", "RFD", "LFU", "RFU", "LBD", "RBD", "LBU", "RBU"];
const along = { R: 1, L: -1, U: 2, D: -2, B: 3, F: -3 };
const cloud = {
  numPoints: 1, shDegree: 0, antialiased: false, extensions: [], sh: new Float32Array(0),
  positions: new Float32Array([1, 2, 3]), scales: new Float32Array([-3, -3, -3]), alphas: new Float32Array([0]),
  rotations: new Float32Array([0, 0, 0, 1]), colors: new Float32Array([0, 0, 0]),
};
const file = spz.saveSpzToBuffer(cloud, { version: 4, from: spz.CoordinateSystem.RUB, sh1Bits: 5, shRestBits: 4 });
const wrong = [];
for (const name of names) {
  const found = [...spz.loadSpzFromBuffer(file, { to: spz.CoordinateSystem[name] }).positions].map(Math.round);
  const said = [...name].map((letter) => along[letter]);
  if (`${found}` === `${said}`) continue;
  wrong.push(name);
  console.log(`${name} ${found} by its letters ${said}`);
}
process.exit(`${wrong}` === "LFD,RFD,LBU,RBU" ? 0 : 1);
JS
node axes.mjs

#!/usr/bin/env bash
# gsplat.js reads Euler angles in another order than it writes them, and its look back over the shoulder is no rotation.
#
# One would expect: Quaternion.FromEuler(q.toEuler()) to be q, and LookRotation(d) to turn forwards, 0 0 1, to d.
# What happens: FromEuler turns about z, then x, then y; toEuler gives angles of x, then y, then z. With one angle both agree.
#   LookRotation of 0 0 -1 puts pi where the cosine of half the angle belongs: the quaternion has length 3.3, and turns
#   and stretches forwards to 6.3 0 8.9. All other directions are right.
# Package: gsplat 1.2.9 (npm). Date: 2026-11-29.
# Why it matters: who reads a scene's or camera's rotation to show or store angles, changes one and sets them, turns the scene
#   in a way nobody asked for; OrbitControls does so with a camera that is set by hand. The camera straight back shows a
#   stretched scene. Keep quaternions; for the way back take 0 1 0 0.
# Output seen:
#   Euler 0.3 0.0 0.0: read 0.30 0.00 0.00, set again 0.0 degrees off
#   Euler 0.3 0.4 0.5: read 0.45 0.21 0.49, set again 13.6 degrees off
#   Euler 1.0 0.4 -0.5: read 0.78 0.79 -0.38, set again 21.6 degrees off
#   LookRotation 1 0 0: forwards becomes 1.00 0.00 0.00
#   LookRotation 0 -1 0: forwards becomes 0.00 -1.00 0.00
#   LookRotation 0 0 -1: forwards becomes 6.28 0.00 8.87
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund gsplat@1.2.9 >>npm.log
cat >turn.mjs <<'JS'
globalThis.window = globalThis.self = globalThis;
globalThis.document = { createElement: () => ({ style: {}, getContext: () => null }) };
const { Quaternion, Vector3 } = await import("gsplat");

const show = (numbers, digits) => numbers.map((number) => (number + 0).toFixed(digits).replace(/^-(0\.?0*)$/, "$1")).join(" ");
const off = [];
for (const angles of [[0.3, 0, 0], [0.3, 0.4, 0.5], [1, 0.4, -0.5]]) {
  const before = Quaternion.FromEuler(new Vector3(...angles));
  const read = before.toEuler();
  const after = Quaternion.FromEuler(read);
  const cosine = before.flat().reduce((sum, number, index) => sum + number * after.flat()[index], 0);
  off.push((Math.acos(Math.min(1, Math.abs(cosine))) * 360) / Math.PI);
  console.log(`Euler ${show(angles, 1)}: read ${show(read.flat(), 2)}, set again ${off.at(-1).toFixed(1)} degrees off`);
}
const missed = [[1, 0, 0], [0, -1, 0], [0, 0, -1]].map((direction) => {
  const turned = Quaternion.LookRotation(new Vector3(...direction)).apply(new Vector3(0, 0, 1)).flat();
  console.log(`LookRotation ${direction.join(" ")}: forwards becomes ${show(turned, 2)}`);
  return Math.hypot(...turned.map((number, index) => number - direction[index]));
});
process.exit(off[0] < 0.01 && off[1] > 1 && off[2] > 1 && missed[0] < 0.01 && missed[1] < 0.01 && missed[2] > 1 ? 0 : 1);
JS
node turn.mjs

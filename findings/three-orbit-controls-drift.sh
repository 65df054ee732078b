#!/usr/bin/env bash
# OrbitControls of three.js move a camera that nobody moves.
#
# One would expect: after damping has run out, update() returns false and leaves the camera as it is.
# What happens: update() returns false, but it computes position and orientation anew from angles each time. Where
#   camera.up is not an axis, rounding changes the last bits of the camera's matrix in every call, for ever, in most
#   views. Where it is the y axis, nothing changes.
# Package: three 0.187.0 (npm). Date: 2026-11-28.
# Why it matters: a splat renderer that sorts anew when the camera's matrix changes (Spark 2.2.0 does for a mesh whose
#   colour depends on direction) never comes to rest: the GPU works for a picture that stands still, and a page that
#   waits for "sorted" waits for ever. Keep the old matrix where update() returns false and the change is rounding.
# Output seen:
#   three 187, up 0,1,0: 0 of 200 resting views change in every update; update() returned true 0 times
#   three 187, up 0.1,-0.95,0.2: 175 of 200 resting views change in every update; update() returned true 0 times
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund three@0.187.0 >>npm.log
cat >drift.mjs <<'JS'
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

const target = () => ({ style: {}, addEventListener() {}, removeEventListener() {}, clientHeight: 100, clientWidth: 100 });
const element = { ...target(), getRootNode: target, ownerDocument: target() };
const VIEWS = 200, UPDATES = 1000;

/** Views whose matrix changes in every update without a touch, and how often the controls said so. */
function rest(up) {
  let drifting = 0, announced = 0;
  for (let view = 0; view < VIEWS; view++) {
    const camera = new THREE.PerspectiveCamera();
    camera.up.set(...up).normalize();
    camera.position.set(3 * Math.sin(view), Math.cos(2 * view), 2 * Math.sin(3 * view + 1));
    const controls = new OrbitControls(camera, element);
    controls.target.set(0.3, 0.2, 0.1);
    controls.enableDamping = true;
    for (let i = 0; i < UPDATES; i++) controls.update();
    camera.updateMatrixWorld();
    let changes = 0;
    for (let i = 0; i < UPDATES; i++) {
      const before = camera.matrixWorld.clone();
      announced += controls.update() ? 1 : 0;
      camera.updateMatrixWorld();
      changes += camera.matrixWorld.equals(before) ? 0 : 1;
    }
    drifting += changes === UPDATES ? 1 : 0;
  }
  const what = `${drifting} of ${VIEWS} resting views change in every update`;
  console.log(`three ${THREE.REVISION}, up ${up}: ${what}; update() returned true ${announced} times`);
  return [drifting, announced];
}

const [still, none] = rest([0, 1, 0]);
const [drifting, announced] = rest([0.1, -0.95, 0.2]);
process.exit(still === 0 && drifting > 0 && none + announced === 0 ? 0 : 1);
JS
node drift.mjs

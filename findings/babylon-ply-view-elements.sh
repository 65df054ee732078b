#!/usr/bin/env bash
# Babylon.js reads a PLY's up axis, handedness and limits of the orbit from the letters at the start of the file.
#
# One would expect: the elements that hold them, of which SPZ's library writes those of the orbit, to be read from where their data is,
#   behind the Gaussians; or not to be read at all.
# What happens: the bytes are taken at the start of the file, whatever the elements hold. "p" of "ply" is neither 0 nor 1, so every
#   up axis is Z and every scene right-handed. "ply" and "form" as floats are 1.2e-32 and 4.7e27, so the camera is kept above
#   the horizon, and not kept from the scene. Nothing is said. A PLY without these elements is right.
# Packages: @babylonjs/loaders 9.28.0 and @babylonjs/core 9.35.0 (npm). Date: 2026-11-30.
# Why it matters: a file that says that y is up lies on its side in this viewer alone, and one that says how near and from where it may
#   be looked at is shown from within and not from below. It looks like wrong numbers of the writer. Leave these elements out.
# Output seen (limits of an orbiting camera: nearest distance, then angle from the zenith in radians):
#   without elements: axis undefined, chirality undefined
#   up_axis 0 (X): axis Z
#   up_axis 1 (Y): axis Z
#   up_axis 2 (Z): axis Z
#   chirality 0 (left): RightHanded
#   chirality 1 (right): RightHanded
#   radius 2.5, elevation -0.2 to 1: limits 1.2e-32, -4.7e+27 to 1.6e+0; should be 2.5e+0, 5.7e-1 to 1.8e+0
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @babylonjs/core@9.35.0 @babylonjs/loaders@9.28.0 >>npm.log
cat >read.mjs <<'JS'
import { SPLATFileLoader } from "@babylonjs/loaders/SPLAT/splatFileLoader.js";

const columns = [..."xyz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];
const gaussian = Float32Array.of(1, 2, 3, 0, 0, 0, 1, -3, -3, -3, 1, 0, 0, 0);

const read = (elements, data) => {
  const lines = ["ply", "format binary_little_endian 1.0", "element vertex 1", ...columns.map((name) => `property float ${name}`)];
  for (const [name, type, count] of elements) lines.push(`element ${name} ${count}`, `property ${type} ${name}`);
  const head = Buffer.from([...lines, "end_header", ""].join("\n"));
  const file = Buffer.concat([head, Buffer.from(gaussian.buffer), Buffer.from(data.buffer)]);
  return SPLATFileLoader._ConvertPLYToSplat(new Uint8Array(file).buffer);
};

const plain = await read([], Uint8Array.of());
console.log(`without elements: axis ${plain.upAxis}, chirality ${plain.chirality}`);
for (const [value, meaning] of ["X", "Y", "Z"].entries()) {
  const scene = await read([["up_axis", "uchar", 1]], Uint8Array.of(value));
  console.log(`up_axis ${value} (${meaning}): axis ${scene.upAxis}`);
}
for (const [value, meaning] of ["left", "right"].entries()) {
  const scene = await read([["chirality", "uchar", 1]], Uint8Array.of(value));
  console.log(`chirality ${value} (${meaning}): ${scene.chirality}`);
}
const [radius, low, high] = [2.5, -0.2, 1];
const orbit = [["safe_orbit_camera_elevation_min_max_radians", "float", 2], ["safe_orbit_camera_radius_min", "float", 1]];
const scene = await read(orbit, Float32Array.of(low, high, radius));
const camera = { getClassName: () => "ArcRotateCamera" };
new SPLATFileLoader().applyAutoCameraLimits(SPLATFileLoader._ExtractSafeOrbitLimits(scene), { activeCamera: camera });
const show = (near, from, to) => `${near.toExponential(1)}, ${from.toExponential(1)} to ${to.toExponential(1)}`;
const limits = show(camera.lowerRadiusLimit, camera.lowerBetaLimit, camera.upperBetaLimit);
const meant = show(radius, Math.PI / 2 - high, Math.PI / 2 - low);
console.log(`radius ${radius}, elevation ${low} to ${high}: limits ${limits}; should be ${meant}`);
JS
node read.mjs | tee seen
diff seen - <<'END'
without elements: axis undefined, chirality undefined
up_axis 0 (X): axis Z
up_axis 1 (Y): axis Z
up_axis 2 (Z): axis Z
chirality 0 (left): RightHanded
chirality 1 (right): RightHanded
radius 2.5, elevation -0.2 to 1: limits 1.2e-32, -4.7e+27 to 1.6e+0; should be 2.5e+0, 5.7e-1 to 1.8e+0
END

#!/usr/bin/env bash
# Babylon.js reads a third of the harmonics of a SOG of version 1, and leaves the others at zero.
#
# One would expect: all 15 coefficients of degree 3, as of the same images under a meta.json of version 2.
# What happens: the number of coefficients, which is a third of the columns, is divided by three once more. The lowest third of
#   the coefficients is read, the others stay zero. The degree is told as it is in the file, and nothing is said.
# Packages: @babylonjs/loaders 9.28.0 and @babylonjs/core 9.35.0 (npm). Date: 2026-11-29.
# Why it matters: version 1 is what `sogs` writes, and what scenes of 2025 on the web are in. Reflections fade in Babylon.js
#   alone, as if the file had lost them. Write such files again as version 2.
# Output seen (coefficients that are not zero):
#   version 1: degree 1, 1 of 3 coefficients
#   version 1: degree 2, 3 of 8 coefficients
#   version 1: degree 3, 5 of 15 coefficients
#   version 2: degree 3, 15 of 15 coefficients
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund --legacy-peer-deps @babylonjs/core@9.35.0 @babylonjs/loaders@9.28.0 >>npm.log
cat >read.mjs <<'JS'
import { ParseSogMeta } from "@babylonjs/loaders/SPLAT/sog.pure.js";

// One Gaussian, and a palette whose coefficients are all the byte 200. Images come decoded: Node has no canvas.
const filled = (width, texel) => ({ width, height: 1, data: new Uint8ClampedArray(Array(width).fill(texel).flat()) });
const engineOf = (images) => ({
  getCaps: () => ({ maxTextureSize: 1 }),
  createCanvasImage: () => ({
    set src(name) {
      Object.assign(this, images[name]);
      queueMicrotask(() => this.onload());
    },
  }),
  createCanvas: (width, height) => {
    let drawn;
    return { width, height, getContext: () => ({ drawImage: (image) => (drawn = image), getImageData: () => drawn }) };
  },
});
const part = (names, members) => ({ ...members, files: names.split(" ") });
const range = (shape, low, high) => ({ shape, dtype: "float32", mins: low, maxs: high });
const three = (value) => [value, value, value];
const codebook = [...Array(256).keys()].map((byte) => byte / 127.5 - 1);

async function count(version, bands) {
  const coefficients = (bands + 1) ** 2 - 1;
  const images = {
    means_l: filled(1, [0, 0, 0, 255]), means_u: filled(1, [128, 128, 128, 255]), scales: filled(1, [128, 128, 128, 255]),
    quats: filled(1, [128, 128, 128, 252]), sh0: filled(1, [128, 128, 128, 200]),
    shN_centroids: filled(64 * coefficients, [200, 200, 200, 255]), shN_labels: filled(1, [0, 0, 0, 255]),
  };
  const means = part("means_l means_u", range([1, 3], three(-1), three(1)));
  const quats = part("quats", { shape: [1, 4], encoding: "quaternion_packed" });
  const meta = version === 1 ? {
    means, quats, scales: part("scales", range([1, 3], three(-5), three(0))),
    sh0: part("sh0", range([1, 1, 4], [-1, -1, -1, -5], [1, 1, 1, 5])),
    shN: part("shN_centroids shN_labels", { ...range([1, 3 * coefficients], -1, 1), quantization: 8 }),
  } : {
    version, count: 1, means, quats, scales: part("scales", { codebook }), sh0: part("sh0", { codebook }),
    shN: part("shN_centroids shN_labels", { count: 64, bands, codebook }),
  };
  const { sh, shDegree } = await ParseSogMeta(meta, "", { getEngine: () => engineOf(images) });
  const bytes = [...Array(3 * coefficients).keys()].map((index) => sh[index >> 4][index & 15]);
  const read = bytes.filter((byte) => byte === 200).length / 3;
  console.log(`version ${version}: degree ${shDegree}, ${read} of ${coefficients} coefficients`);
  return read;
}
const found = [];
for (const [version, bands] of [[1, 1], [1, 2], [1, 3], [2, 3]]) found.push(await count(version, bands));
process.exit(found.join() === "1,3,5,15" ? 0 : 1);
JS
node read.mjs

#!/usr/bin/env bash
# spz-js reads the harmonics of a compressed PLY right at degree 3 alone; below, colours are missing or swapped.
#
# One would expect: a file of degree 1 or 2 gives its 9 or 24 coefficients, as one of degree 3 gives its 45: the number of
#   degrees is the only difference.
# What happens: the loop over red, green and blue runs as often as there are degrees, and looks for green where degree 3 has
#   it. Degree 1 gets red alone, the others are 0. Degree 2 gets red, a green of the wrong numbers, and no blue.
# Package: spz-js 1.2.5 (npm). Date: 2026-11-29.
# Why it matters: degrees 1 and 2 are what exports for the web keep. The SPZ that is made of them has a tint that turns with
#   the view. Convert through a plain PLY.
# Output seen (coefficients of each colour that are as in the file):
#   degree 1: red 3 of 3, green 0 of 3, blue 0 of 3
#   degree 2: red 8 of 8, green 0 of 8, blue 0 of 8
#   degree 3: red 15 of 15, green 15 of 15, blue 15 of 15
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund spz-js@1.2.5 >>npm.log
cat >read.mjs <<'JS'
import { loadCompressedPly } from "spz-js";

const ends = (name) => ["min", "max"].flatMap((end) => ["x", "y", "z"].map((axis) => `${end}_${name}${axis}`));
const colours = ["min_r", "min_g", "min_b", "max_r", "max_g", "max_b"];
const chunk = [...ends(""), ...ends("scale_"), ...colours];
const words = ["position", "rotation", "scale", "color"].map((part) => `property uint packed_${part}`);

let asDescribed = true;
for (const degree of [1, 2, 3]) {
  const count = (degree + 1) ** 2 - 1;
  const bytes = Uint8Array.from({ length: 3 * count }, (_, index) => 140 + index);
  const rest = [...bytes.keys()].map((index) => `property uchar f_rest_${index}`);
  const head = ["ply", "format binary_little_endian 1.0", "element chunk 1", ...chunk.map((name) => `property float ${name}`)];
  const text = [...head, "element vertex 1", ...words, "element sh 1", ...rest, "end_header", ""].join("\n");
  const body = [new Uint8Array(new Float32Array(18).fill(1).buffer), new Uint8Array(16), bytes];
  const { sh } = await loadCompressedPly(new Blob([text, ...body]).stream());
  // The file has all of red first, the result red, green and blue of each coefficient.
  const right = [0, 1, 2].map((colour) => {
    const close = (index) => Math.abs(sh[3 * index + colour] - (bytes[colour * count + index] * 8 / 255 - 4)) < 0.02;
    return [...Array(count).keys()].filter(close).length;
  });
  const told = ["red", "green", "blue"].map((name, index) => `${name} ${right[index]} of ${count}`);
  console.log(`degree ${degree}: ${told.join(", ")}`);
  asDescribed &&= right.join() === (degree === 3 ? [count, count, count] : [count, 0, 0]).join();
}
process.exit(asDescribed ? 0 : 1);
JS
node read.mjs

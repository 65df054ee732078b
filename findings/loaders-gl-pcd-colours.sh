#!/usr/bin/env bash
# loaders.gl shows no colour of a PCD right: red and blue are swapped, integers in text are noise, compressed files are black.
#
# One would expect: the field rgb, a word with red in bits 16 to 23, to be red, green and blue in COLOR_0, in each of the three
#   encodings and both types (float, as PCL and Open3D write it, and unsigned) of the format.
# What happens: the bytes of the word are taken in the order in which they lie, blue first. In text the number is written into a
#   float before its bytes are taken, so that unsigned words give bytes of other numbers. Of compressed files they are divided
#   by 255 and then cut to bytes, so that 0 is left of all but 255. Positions are right in all.
# Packages: @loaders.gl/core and @loaders.gl/pcd 4.4.2, three 0.187.0 (npm). Date: 2026-11-30.
# Why it matters: clouds in deck.gl beside Gaussians have blue skin and orange skies, or are black. A swap by hand mends float
#   files in text and binary ones, and breaks with the fix. Convert clouds to PLY.
# Output seen (the colour 255 64 128):
#   ascii F: loaders.gl 128 64 255, three.js 255 64 128
#   ascii U: loaders.gl 128 64 127, three.js 255 64 128
#   binary F: loaders.gl 128 64 255, three.js 255 64 128
#   binary U: loaders.gl 128 64 255, three.js 255 64 128
#   binary_compressed F: loaders.gl 0 0 1, three.js 255 64 128
#   binary_compressed U: loaders.gl 0 0 1, three.js 255 64 128
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @loaders.gl/core@4.4.2 @loaders.gl/pcd@4.4.2 @math.gl/types@4.1.0 three@0.187.0 >>npm.log
cat >read.mjs <<'JS'
import { parse } from "@loaders.gl/core";
import { PCDLoader } from "@loaders.gl/pcd";
import { Color } from "three";
import { PCDLoader as ThreeLoader } from "three/examples/jsm/loaders/PCDLoader.js";

const PLACES = [[1, 2, 3], [4, 5, 6]];
const COLOURS = [[255, 64, 128], [10, 20, 30]];
const words = Uint32Array.from(COLOURS, ([red, green, blue]) => (red << 16) | (green << 8) | blue);

const make = (encoding, type) => {
  const head = ["# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7", "FIELDS x y z rgb", "SIZE 4 4 4 4", `TYPE F F F ${type}`,
    "COUNT 1 1 1 1", "WIDTH 2", "HEIGHT 1", "VIEWPOINT 0 0 0 1 0 0 0", "POINTS 2", `DATA ${encoding}`, ""].join("\n");
  const numbers = type === "F" ? new Float32Array(words.buffer) : words;
  if (encoding === "ascii") return Buffer.from(head + PLACES.map((place, row) => `${place.join(" ")} ${numbers[row]}\n`).join(""));
  const byRow = Buffer.concat(PLACES.map((place, row) => Buffer.from(new Uint32Array(
    [...new Uint32Array(new Float32Array(place).buffer), words[row]]).buffer)));
  if (encoding === "binary") return Buffer.concat([Buffer.from(head), byRow]);
  // Of column after column; the whole is one run of 32 bytes that LZF leaves as they are.
  const byColumn = Buffer.concat([0, 4, 8, 12].flatMap((at) => [byRow.subarray(at, at + 4), byRow.subarray(at + 16, at + 20)]));
  const sizes = Buffer.from(new Uint32Array([byColumn.length + 1, byColumn.length]).buffer);
  return Buffer.concat([Buffer.from(head), sizes, Buffer.from([byColumn.length - 1]), byColumn]);
};

for (const encoding of ["ascii", "binary", "binary_compressed"]) {
  for (const type of ["F", "U"]) {
    const file = new Uint8Array(make(encoding, type)).buffer;
    const read = (await parse(file.slice(0), PCDLoader, { worker: false, core: { worker: false } })).attributes;
    const { geometry } = new ThreeLoader().parse(file.slice(0));
    for (const places of [read.POSITION.value, geometry.attributes.position.array]) {
      if (`${[...places]}` !== `${PLACES.flat()}`) throw new Error("positions differ");
    }
    const linear = geometry.attributes.color;
    const shown = new Color(linear.getX(0), linear.getY(0), linear.getZ(0)).convertLinearToSRGB().toArray();
    const three = shown.map((value) => Math.round(255 * value)).join(" ");
    console.log(`${encoding} ${type}: loaders.gl ${[...read.COLOR_0.value.subarray(0, 3)].join(" ")}, three.js ${three}`);
  }
}
JS
node read.mjs | tee seen
diff seen - <<'END'
ascii F: loaders.gl 128 64 255, three.js 255 64 128
ascii U: loaders.gl 128 64 127, three.js 255 64 128
binary F: loaders.gl 128 64 255, three.js 255 64 128
binary U: loaders.gl 128 64 255, three.js 255 64 128
binary_compressed F: loaders.gl 0 0 1, three.js 255 64 128
binary_compressed U: loaders.gl 0 0 1, three.js 255 64 128
END

#!/usr/bin/env bash
# three.js cuts numbers to half floats towards zero; PlayCanvas, and the standard, take the nearest.
#
# One would expect: DataUtils.toHalfFloat to round to the nearest half float, as IEEE 754, Float16Array and NumPy do, and
#   as the engine of PlayCanvas does.
# What happens: it drops the bits that do not fit. Results are up to a whole step too small, half a step on average: 0.035 %
#   of each value. Numbers just below 2^-24, whose nearest half float is 2^-24, become 0.
# Packages: three 0.187.0 and playcanvas 2.23.3 (npm). Date: 2026-11-28.
# Why it matters: writers of .ksplat convert sizes, rotations and harmonics by it, and viewers their positions: all
#   shrink towards zero, which does not average out. Every further round trip through other values cuts again.
# Output seen:
#   1.0009: nearest 1.0009765625, three.js 1, PlayCanvas 1.0009765625
#   2047.9: nearest 2048, three.js 2047, PlayCanvas 2048
#   5.9e-8: nearest 5.960464477539063e-8, three.js 0, PlayCanvas 5.960464477539063e-8
#   mean relative error over 20000 numbers: three.js -0.000348, PlayCanvas -0.000000
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund three@0.187.0 playcanvas@2.23.3 >>npm.log
cat >halves.mjs <<'JS'
import { FloatPacking } from "playcanvas";
import { DataUtils } from "three";

const number = (half) => {
  const [sign, exponent, mantissa] = [half >> 15 ? -1 : 1, (half >> 10) & 31, half & 1023];
  return sign * (exponent ? (1 + mantissa / 1024) * 2 ** (exponent - 15) : mantissa * 2 ** -24);
};
const halves = [...Array(0x7c00).keys()].map(number);
const nearest = (value) => halves.reduce((best, half) => (Math.abs(half - value) < Math.abs(best - value) ? half : best));
const cut = (value) => halves.findLast((half) => half <= value);

let asDescribed = true;
for (const value of [1.0009, 2047.9, 5.9e-8]) {
  const three = number(DataUtils.toHalfFloat(value)), playCanvas = number(FloatPacking.float2Half(value));
  console.log(`${value}: nearest ${nearest(value)}, three.js ${three}, PlayCanvas ${playCanvas}`);
  asDescribed &&= three === cut(value) && playCanvas === nearest(value) && three !== playCanvas;
}
const values = [...Array(20000).keys()].map((index) => Math.exp(-4 + index / 5000));
const mean = (convert) => values.reduce((sum, value) => sum + number(convert(value)) / value - 1, 0) / values.length;
const three = mean(DataUtils.toHalfFloat), playCanvas = mean(FloatPacking.float2Half);
console.log(`mean relative error over ${values.length} numbers: three.js ${three.toFixed(6)}, PlayCanvas ${playCanvas.toFixed(6)}`);
asDescribed &&= three < -0.0003 && Math.abs(playCanvas) < 0.00001;
process.exit(asDescribed ? 0 : 1);
JS
node halves.mjs

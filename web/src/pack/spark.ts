/**
 * Words of Spark's packed splats (Spark 2.x, its default encoding).
 *
 * A splat has four words: colour r, g, b and opacity, 8 bits each; centre x, y as binary16; centre z and two octahedral
 * bytes of the axis of rotation; three scales, and the angle. Spherical harmonics are signed numbers of 7, 8 and 6 bits
 * for degrees 1, 2 and 3, by coefficient, then colour.
 */

import type { PackedTile, TileValues } from "../decoder/types.js";
import { toHalf } from "./half.js";

const SH_0 = 0.28209479177387814;
/** Logarithms of the least and largest scale; byte 0 is a scale of 0, bytes 1..255 span the range. */
const LOG_SCALE = { least: -12, most: 9 };
const FLAT = Math.exp(-30);
/** By degree: words a splat, bits a number, first coefficient, how many numbers. */
const BANDS = [
  { words: 2, bits: 7, first: 1, numbers: 9 },
  { words: 4, bits: 8, first: 4, numbers: 15 },
  { words: 4, bits: 6, first: 9, numbers: 21 },
] as const;

/** @returns fresh arrays of exactly `count` splats */
export function packSpark(values: TileValues): PackedTile {
  const { tile, layer, count, shDegree } = values;
  const words = new Uint32Array(4 * count);
  for (let i = 0; i < count; i++) packSplat(values, i, words);
  const [sh1, sh2, sh3] = BANDS.map((band, i) => (shDegree > i ? packBand(values, band) : null));
  return { tile, layer, count, words, sh1, sh2, sh3 };
}

function packSplat({ centres, scales, quats, opacity, sh, shDegree }: TileValues, i: number, words: Uint32Array): void {
  const colourAt = i * 3 * (shDegree + 1) ** 2;
  const colour = (c: number) => byte(0.5 + SH_0 * sh[colourAt + c]);
  const turn = packRotation(quats, 4 * i);
  const at = 4 * i;
  const size = (axis: number) => packScale(scales[3 * i + axis]);
  words[at] = colour(0) | (colour(1) << 8) | (colour(2) << 16) | (byte(opacity[i]) << 24);
  words[at + 1] = toHalf(centres[3 * i]) | (toHalf(centres[3 * i + 1]) << 16);
  words[at + 2] = toHalf(centres[3 * i + 2]) | ((turn & 0xffff) << 16);
  words[at + 3] = size(0) | (size(1) << 8) | (size(2) << 16) | ((turn >>> 16) << 24);
}

function byte(x: number): number {
  return Math.round(255 * Math.min(Math.max(x, 0), 1));
}

function packScale(scale: number): number {
  if (!(scale >= FLAT)) return 0;
  const { least, most } = LOG_SCALE;
  const step = Math.round(((Math.log(scale) - least) * 254) / (most - least));
  return Math.min(Math.max(step + 1, 1), 255);
}

/** Axis folded to an octahedron, two bytes; above them the angle, 0..pi in 255 steps. */
function packRotation(quats: Float32Array, at: number): number {
  const sign = quats[at] < 0 ? -1 : 1;
  const w = Math.min(sign * quats[at], 1);
  const axis = [1, 2, 3].map((i) => sign * quats[at + i]);
  const length = Math.hypot(...axis);
  const [x, y, z] = length < 1e-6 ? [1, 0, 0] : axis.map((c) => c / length);
  const sum = Math.abs(x) + Math.abs(y) + Math.abs(z);
  let [u, v] = [x / sum, y / sum];
  if (z < 0) [u, v] = [(1 - Math.abs(v)) * (u >= 0 ? 1 : -1), (1 - Math.abs(u)) * (v >= 0 ? 1 : -1)];
  const unit = (c: number) => Math.round((c / 2 + 0.5) * 255);
  const angle = Math.round((2 * Math.acos(w) * 255) / Math.PI);
  return (angle << 16) | (unit(v) << 8) | unit(u);
}

function packBand({ count, sh, shDegree }: TileValues, band: (typeof BANDS)[number]): Uint32Array {
  const { words, bits, first, numbers } = band;
  const width = 3 * (shDegree + 1) ** 2;
  const most = 2 ** (bits - 1) - 1;
  const out = new Uint32Array(words * count);
  for (let i = 0; i < count; i++) {
    for (let j = 0, bit = 0; j < numbers; j++, bit += bits) {
      const x = Math.min(Math.max(sh[i * width + 3 * first + j], -1), 1);
      const value = Math.round(x * most) & (2 ** bits - 1);
      const word = i * words + (bit >>> 5);
      const shift = bit & 31;
      out[word] |= value << shift;
      if (shift + bits > 32) out[word + 1] |= value >>> (32 - shift);
    }
  }
  return out;
}

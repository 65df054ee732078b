/**
 * How a decoded tile is laid into the textures that the adapters draw from.
 *
 * A Gaussian is eight words of geometry (two RGBA32UI texels), and one texel for each degree of its spherical harmonics:
 *
 *     0..2   centre, three float32
 *     3      ln scale of the first axis (low 16 bits) and the second; steps of 1/2048 from -20
 *     4      ln scale of the third; first kept component of the quaternion
 *     5      second and third kept component
 *     6      red (low 16 bits) and green, float16, of the colour seen when degrees above 0 are left out
 *     7      blue, float16; opacity in steps of 1/16383 (bits 18..31); which component was left out (bits 16..17)
 *
 * Of a unit quaternion (w x y z) the largest component is left out and made positive; the others lie within ±sqrt(1/2)
 * and take signed steps of sqrt(1/2)/32767. Harmonics are signed bytes, coefficient by coefficient, each red, green, blue;
 * the last 16 bits of the last texel are the float16 that a byte of 127 stands for. A slot of zeros draws nothing.
 */

import type { PackedTile, TileValues } from "../decoder/types.js";
import { toHalf } from "./half.js";

export const GEOMETRY_TEXELS = 2;
export const LN_SCALE_MIN = -20;
export const LN_SCALE_STEPS = 2048;
export const OPACITY_STEPS = 16383;
const QUATERNION_STEPS = 32767 / Math.SQRT1_2;
const LARGEST_HALF = 65504;
/** SH basis of degree 0: 1 / (2 sqrt(pi)). */
const C0 = 0.28209479177387814;

function lnScale(scale: number): number {
  const steps = Math.round((Math.log(scale) - LN_SCALE_MIN) * LN_SCALE_STEPS);
  return Math.min(Math.max(steps, 0), 65535);
}

/** Quaternion (w x y z) from `at` in `quats` as four numbers: what is left out, and three signed steps. */
function smallestThree(quats: Float32Array, at: number, out: Int32Array): void {
  let largest = 0;
  for (let k = 1; k < 4; k++) if (Math.abs(quats[at + k]) > Math.abs(quats[at + largest])) largest = k;
  const norm = Math.hypot(quats[at], quats[at + 1], quats[at + 2], quats[at + 3]);
  const steps = (quats[at + largest] < 0 ? -QUATERNION_STEPS : QUATERNION_STEPS) / (norm > 0 ? norm : 1);
  out[0] = largest;
  for (let k = 0, kept = 1; k < 4; k++) {
    if (k !== largest) out[kept++] = Math.min(Math.max(Math.round(quats[at + k] * steps), -32767), 32767);
  }
}

/** Words of a tile; a worker's task. */
export function packWords(values: TileValues): PackedTile {
  const { tile, layer, count, shDegree } = values;
  const geometry = new Uint32Array(8 * count);
  geometryWords(values, geometry);
  const harmonics = new Uint32Array(4 * shDegree * count);
  if (shDegree > 0) harmonicWords(values, harmonics);
  return { tile, layer, count, shDegree, geometry, harmonics };
}

function geometryWords(values: TileValues, words: Uint32Array): void {
  const { count, centres, scales, quats, opacity, sh, shDegree } = values;
  const centre = new Float32Array(words.buffer);
  const stride = 3 * (shDegree + 1) ** 2;
  const kept = new Int32Array(4);
  for (let i = 0; i < count; i++) {
    const at = 8 * i;
    for (let axis = 0; axis < 3; axis++) centre[at + axis] = centres[3 * i + axis];
    smallestThree(quats, 4 * i, kept);
    words[at + 3] = lnScale(scales[3 * i]) | (lnScale(scales[3 * i + 1]) << 16);
    words[at + 4] = lnScale(scales[3 * i + 2]) | (kept[1] << 16);
    words[at + 5] = (kept[2] & 0xffff) | (kept[3] << 16);
    words[at + 6] = colour(sh[stride * i]) | (colour(sh[stride * i + 1]) << 16);
    words[at + 7] = colour(sh[stride * i + 2]) | (kept[0] << 16) | (Math.round(opacity[i] * OPACITY_STEPS) << 18);
  }
}

/** Of a coefficient of degree 0. */
function colour(coefficient: number): number {
  return largestHalf(0.5 + C0 * coefficient);
}

/** The binary16 next to a number, never an infinity. */
function largestHalf(x: number): number {
  return toHalf(Math.min(Math.max(x, -LARGEST_HALF), LARGEST_HALF));
}

function harmonicWords({ count, sh, shDegree }: TileValues, words: Uint32Array): void {
  const bytes = new Int8Array(words.buffer);
  const stride = 3 * (shDegree + 1) ** 2;
  const numbers = stride - 3;
  for (let i = 0; i < count; i++) {
    const from = stride * i + 3;
    let peak = 0;
    for (let k = 0; k < numbers; k++) peak = Math.max(peak, Math.abs(sh[from + k]));
    const steps = peak > 0 ? 127 / peak : 0;
    const at = 16 * shDegree * i;
    for (let k = 0; k < numbers; k++) bytes[at + k] = Math.round(sh[from + k] * steps);
    words[4 * shDegree * (i + 1) - 1] |= largestHalf(peak) << 16;
  }
}

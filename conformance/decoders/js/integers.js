/** Integer arithmetic of the neural entropy model (SPEC §10.1). */

import { readRice, readShifted } from "./rice.js";

/**
 * @typedef {import("./bytes.js").Reader} Reader
 * @typedef {{rows: number, columns: number, weights: Int32Array, biases: Int32Array, shift: number}} Linear
 *   weights: (rows, columns)
 */

export const ACCUMULATOR_LIMIT = 2 ** 24;
const MAX_WEIGHT = 32767;
export const MAX_SHIFT = 24;

// The tables of R-10.1-2, 32 steps to 1 of the argument (TANH, SIGMOID) or to one bit (EXP2).
// prettier-ignore
const TANH = Int32Array.from([
  0, 64, 128, 191, 255, 317, 379, 441, 501, 561, 620, 677, 734, 789, 842, 895, 946, 996, 1044, 1090, 1135, 1179, 1221,
  1261, 1300, 1338, 1373, 1408, 1441, 1472, 1503, 1531, 1559, 1585, 1610, 1634, 1657, 1678, 1699, 1718, 1736, 1754,
  1770, 1786, 1801, 1815, 1828, 1841, 1853, 1864, 1875, 1885, 1894, 1903, 1912, 1919, 1927, 1934, 1941, 1947, 1953,
  1959, 1964, 1969, 1973, 1978, 1982, 1986, 1989, 1993, 1996, 1999, 2002, 2005, 2007, 2010, 2012, 2014, 2016, 2018,
  2020, 2021, 2023, 2024, 2026, 2027, 2028, 2029, 2030, 2031, 2032, 2033, 2034, 2035, 2036, 2036, 2037, 2037, 2038,
  2039, 2039, 2040, 2040, 2040, 2041, 2041, 2042, 2042, 2042, 2043, 2043, 2043, 2043, 2043, 2044, 2044, 2044, 2044,
  2044, 2045, 2045, 2045, 2045, 2045, 2045, 2045, 2045, 2046, 2046, 2046, 2046, 2046, 2046, 2046, 2046, 2046, 2046,
  2046, 2046, 2046, 2046, 2046, 2046, 2046, 2046, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047,
  2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047,
  2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047,
  2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047,
  2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047,
  2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047, 2047,
  2047, 2047, 2047, 2047, 2047,
]);
// prettier-ignore
const SIGMOID = Int32Array.from([
  2048, 2080, 2112, 2144, 2176, 2208, 2239, 2271, 2303, 2334, 2365, 2397, 2428, 2458, 2489, 2519, 2550, 2580, 2609,
  2639, 2668, 2697, 2726, 2754, 2782, 2810, 2837, 2864, 2891, 2917, 2943, 2969, 2994, 3019, 3044, 3068, 3092, 3116,
  3139, 3161, 3184, 3206, 3227, 3249, 3269, 3290, 3310, 3330, 3349, 3368, 3386, 3404, 3422, 3440, 3457, 3473, 3490,
  3506, 3521, 3536, 3551, 3566, 3580, 3594, 3608, 3621, 3634, 3647, 3659, 3671, 3683, 3694, 3705, 3716, 3727, 3737,
  3747, 3757, 3767, 3776, 3785, 3794, 3803, 3811, 3819, 3827, 3835, 3843, 3850, 3857, 3864, 3871, 3877, 3884, 3890,
  3896, 3902, 3907, 3913, 3918, 3924, 3929, 3934, 3938, 3943, 3948, 3952, 3956, 3960, 3965, 3968, 3972, 3976, 3980,
  3983, 3986, 3990, 3993, 3996, 3999, 4002, 4005, 4007, 4010, 4013, 4015, 4018, 4020, 4022, 4025, 4027, 4029, 4031,
  4033, 4035, 4037, 4038, 4040, 4042, 4043, 4045, 4047, 4048, 4050, 4051, 4052, 4054, 4055, 4056, 4057, 4059, 4060,
  4061, 4062, 4063, 4064, 4065, 4066, 4067, 4068, 4069, 4069, 4070, 4071, 4072, 4073, 4073, 4074, 4075, 4075, 4076,
  4077, 4077, 4078, 4078, 4079, 4079, 4080, 4080, 4081, 4081, 4082, 4082, 4083, 4083, 4083, 4084, 4084, 4085, 4085,
  4085, 4086, 4086, 4086, 4086, 4087, 4087, 4087, 4088, 4088, 4088, 4088, 4089, 4089, 4089, 4089, 4089, 4090, 4090,
  4090, 4090, 4090, 4091, 4091, 4091, 4091, 4091, 4091, 4091, 4092, 4092, 4092, 4092, 4092, 4092, 4092, 4092, 4093,
  4093, 4093, 4093, 4093, 4093, 4093, 4093, 4093, 4093, 4094, 4094, 4094, 4094, 4094, 4094, 4094, 4094, 4094, 4094,
  4094, 4094, 4094, 4094, 4094, 4094, 4094, 4095, 4095,
]);
// prettier-ignore
const EXP2 = Int32Array.from([
  65536, 64132, 62757, 61413, 60097, 58809, 57549, 56316, 55109, 53928, 52773, 51642, 50535, 49452, 48393, 47356,
  46341, 45348, 44376, 43425, 42495, 41584, 40693, 39821, 38968, 38133, 37316, 36516, 35734, 34968, 34219, 33486,
]);

/** @param {number} s @returns {number} half(s) */
export const half = (s) => (s === 0 ? 0 : 2 ** (s - 1));

/**
 * v / 2^s to the nearest, ties up; v and the half fit in 32 bits.
 * @param {number} v
 * @param {number} s 0..24
 */
export const roundShift = (v, s) => (v + ((1 << s) >> 1)) >> s;

/** @param {number} x @param {number} low @param {number} high */
export const clamp = (x, low, high) => (x < low ? low : x > high ? high : x);

/** @param {number} a activation bits @returns {number} amax */
export const activationLimit = (a) => 2 ** (a - 1) - 1;

/** @param {number} u @returns {number} -2047..2047 */
export const tanh12 = (u) => (u >= 0 ? TANH[u > 255 ? 255 : u] : -TANH[u < -255 ? 255 : -u]);

/** @param {number} u @returns {number} 1..4095 */
export const sigmoid12 = (u) => (u >= 0 ? SIGMOID[u > 255 ? 255 : u] : 4096 - SIGMOID[u < -255 ? 255 : -u]);

/** @param {number} d 0 or more @returns {number} 0..65536 */
export const exp2w = (d) => (d > 511 ? 0 : EXP2[d & 31] >> (d >> 5));

/**
 * round_shift(W x, s) clamped, with sums that R-10.1-1 keeps below 2^24. Four rows at a time.
 * @param {Linear} layer
 * @param {Int32Array} x
 * @param {number} at of the vector in x
 * @param {number} low
 * @param {number} high
 * @param {Int32Array} out
 * @param {number} to of the result in out
 */
export function applyLinear(layer, x, at, low, high, out, to) {
  const { rows, columns, weights, biases, shift } = layer;
  product(weights, rows, columns, x, at, biases, out, to);
  const add = (1 << shift) >> 1;
  for (let r = to; r < to + rows; r++) {
    const v = (out[r] + add) >> shift;
    out[r] = v < low ? low : v > high ? high : v;
  }
}

/**
 * W x + b, all of it below 2^31.
 * @param {Int32Array} weights (rows, columns)
 * @param {number} rows
 * @param {number} columns
 * @param {Int32Array} x
 * @param {number} at of the vector in x
 * @param {Int32Array} biases (rows)
 * @param {Int32Array} out
 * @param {number} to of the result in out
 */
export function product(weights, rows, columns, x, at, biases, out, to) {
  let r = 0;
  for (; r + 4 <= rows; r += 4) {
    let s0 = biases[r];
    let s1 = biases[r + 1];
    let s2 = biases[r + 2];
    let s3 = biases[r + 3];
    let w0 = r * columns;
    let w1 = w0 + columns;
    let w2 = w1 + columns;
    let w3 = w2 + columns;
    for (let c = at; c < at + columns; c++) {
      const v = x[c];
      s0 = (s0 + Math.imul(weights[w0++], v)) | 0;
      s1 = (s1 + Math.imul(weights[w1++], v)) | 0;
      s2 = (s2 + Math.imul(weights[w2++], v)) | 0;
      s3 = (s3 + Math.imul(weights[w3++], v)) | 0;
    }
    out[to + r] = s0;
    out[to + r + 1] = s1;
    out[to + r + 2] = s2;
    out[to + r + 3] = s3;
  }
  for (; r < rows; r++) {
    let sum = biases[r];
    for (let c = 0, w = r * columns; c < columns; c++) sum = (sum + Math.imul(weights[w++], x[at + c])) | 0;
    out[to + r] = sum;
  }
}

/**
 * `matrix(rows, columns)` of §10.5.
 * @param {Reader} reader
 * @param {number} n rows * columns
 * @param {string} id of the refusal
 * @returns {Int32Array}
 */
export function readWeights(reader, n, id) {
  const weights = readRice(reader, n);
  for (const weight of weights) reader.demand(Math.abs(weight) <= MAX_WEIGHT, id, `weight ${weight}`);
  return weights;
}

/**
 * `linear(rows, columns)` of §10.5, ranges of shift and sums not yet checked.
 * @param {Reader} reader
 * @param {number} rows
 * @param {number} columns
 * @param {string} id
 * @returns {Linear}
 */
export function readLinear(reader, rows, columns, id) {
  const shift = reader.u8();
  const weights = readWeights(reader, rows * columns, id);
  return { rows, columns, shift, weights, biases: readShifted(reader, rows) };
}

/**
 * Whether sum of |weights| * amax + |bias| + half(shift) is below the limit in every row.
 * @param {Int32Array} weights (rows, columns)
 * @param {number} columns
 * @param {ArrayLike<number>} biases (rows)
 * @param {number} shift
 * @param {number} amax
 * @param {number} [limit]
 */
export function keepsReach(weights, columns, biases, shift, amax, limit = ACCUMULATOR_LIMIT) {
  for (let r = 0, w = 0; r < biases.length; r++) {
    let sum = 0;
    for (let c = 0; c < columns; c++) sum += Math.abs(weights[w++]);
    if (sum * amax + Math.abs(biases[r]) + half(shift) >= limit) return false;
  }
  return true;
}

/**
 * R-10.1-1 but the range of the weights.
 * @param {Linear} layer
 * @param {number} amax
 */
export function linearFits({ rows, columns, weights, biases, shift }, amax) {
  return rows >= 1 && columns >= 1 && shift <= MAX_SHIFT && keepsReach(weights, columns, biases, shift, amax);
}

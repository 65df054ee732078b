/** Cells, passes and cell means of the decoded context (SPEC §10.2). */

/**
 * @typedef {import("./positions.js").Codes} Codes
 * For each depth in the order of the targets: the number of cells with anchors, and the cell of each anchor.
 * @typedef {{count: number, of: Uint32Array}} Depth
 */

const CLAMP = 2 ** 24;
const POWERS = Float64Array.from({ length: 21 }, (_, n) => 3 ** n);

/**
 * @param {number} v
 * @param {number} n steps, 0..20
 * @returns {number} fine(v, n)
 */
export function fine(v, n) {
  if (n === 0) return 0;
  const power = POWERS[n - 1];
  const value = Math.floor((2048 * v + power) / (2 * power));
  return value > CLAMP ? CLAMP : value < -CLAMP ? -CLAMP : value;
}

/**
 * Merges anchors that are appended, with ascending codes, into an order by code, then index.
 * @param {Codes} codes of all anchors
 * @param {Uint32Array} before the order of the first of them
 * @returns {Uint32Array} the order of all
 */
export function mergeByCode({ high, low }, before) {
  const merged = new Uint32Array(high.length);
  for (let i = 0, old = 0, added = before.length; i < merged.length; i++) {
    const a = before[old];
    const takeOld =
      added === merged.length ||
      (old < before.length && (high[a] !== high[added] ? high[a] < high[added] : low[a] <= low[added]));
    merged[i] = takeOld ? before[old++] : added++;
  }
  return merged;
}

/**
 * R-10.2-3.
 * @param {Codes} codes
 * @param {Uint32Array} byCode
 * @param {number[]} targets
 * @param {number} b local bits
 * @returns {Depth[]}
 */
export function findDepths(codes, byCode, targets, b) {
  const levels = separations(codes, byCode);
  const counts = new Uint32Array(b + 1).fill(byCode.length > 0 ? 1 : 0);
  for (let i = 1; i < levels.length; i++) for (let e = 0; e <= levels[i]; e++) counts[e]++;
  return targets.map((target) => {
    let e = 0;
    while (e < b && counts[e] * target > byCode.length) e++;
    const of = new Uint32Array(byCode.length);
    for (let i = 0, cell = 0; i < byCode.length; i++) {
      if (i > 0 && levels[i] >= e) cell++;
      of[byCode[i]] = cell;
    }
    return { count: counts[e], of };
  });
}

/**
 * The largest depth at which the i-th anchor by code is in another cell than the one before it, or -1.
 * @param {Codes} codes
 * @param {Uint32Array} byCode
 * @returns {Int8Array}
 */
function separations({ high, low }, byCode) {
  const levels = new Int8Array(byCode.length).fill(-1);
  for (let i = 1; i < byCode.length; i++) {
    const a = byCode[i - 1];
    const c = byCode[i];
    const highBits = high[a] ^ high[c];
    const lowBits = low[a] ^ low[c];
    const bit = highBits !== 0 ? 63 - Math.clz32(highBits) : 31 - Math.clz32(lowBits);
    levels[i] = Math.floor(bit / 3);
  }
  return levels;
}

/**
 * R-10.2-4.
 * @param {Uint32Array} group anchors by code
 * @param {number} log2
 * @returns {Uint32Array[]} passes, some perhaps empty
 */
export function passesOf(group, log2) {
  const every = (/** @type {number} */ first, /** @type {number} */ stride) =>
    Uint32Array.from(
      { length: Math.max(Math.ceil((group.length - first) / stride), 0) },
      (_, i) => group[first + i * stride],
    );
  let stride = 2 ** log2;
  const passes = [every(0, stride)];
  for (; stride > 1; stride /= 2) passes.push(every(stride / 2, stride));
  return passes;
}

/** A collection E of anchors with rows of numbers, and its cell means (R-10.2-5). */
export class Surroundings {
  /**
   * @param {Depth[]} depths
   * @param {number} columns
   */
  constructor(depths, columns) {
    this.depths = depths;
    this.columns = columns;
    this.sums = depths.map(({ count }) => new Float64Array(count * columns));
    this.counts = depths.map(({ count }) => new Uint32Array(count));
  }

  /**
   * @param {number} a
   * @param {ArrayLike<number>} row (columns)
   */
  add(a, row) {
    const { columns } = this;
    for (let d = 0; d < this.depths.length; d++) {
      const cell = this.depths[d].of[a];
      const sums = this.sums[d];
      this.counts[d][cell]++;
      for (let c = 0, at = cell * columns; c < columns; c++) sums[at + c] += row[c];
    }
  }

  /**
   * @param {number} a
   * @param {Float64Array} means at least (depths, columns) from `meansAt` on
   * @param {number} meansAt
   * @param {Int32Array} features at least (depths) from `featuresAt` on: count features
   * @param {number} featuresAt
   */
  around(a, means, meansAt, features, featuresAt) {
    const { columns } = this;
    for (let d = 0, out = meansAt; d < this.depths.length; d++, out += columns) {
      const cell = this.depths[d].of[a];
      const n = this.counts[d][cell];
      const sums = this.sums[d];
      features[featuresAt + d] = 32 * Math.min(32 - Math.clz32(n), 8);
      for (let c = 0; c < columns; c++) {
        if (n > 0) means[out + c] = Math.floor((2 * sums[cell * columns + c] + n) / (2 * n));
        else means[out + c] = d > 0 ? means[out - columns + c] : 0;
      }
    }
  }
}

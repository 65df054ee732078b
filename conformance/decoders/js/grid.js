/** HASH_GRID blocks and the features they give (SPEC §10.6). */

import { Reader } from "./bytes.js";
import { clamp, roundShift } from "./integers.js";
import { RansStream } from "./rans.js";
import { cumulativeFrequencies, Table } from "./tables.js";

/**
 * @typedef {{axes: number[], resolution: number, tableLog2: number, features: number, dense: boolean,
 *   entries: number, bits: Uint8Array}} Level bits: (entries, features)
 * @typedef {{origin: number[], extentBits: number, levels: Level[], features: number}} Grid
 */

/** Axes of each plane. */
const PLANES = [[0, 1, 2], [0, 1], [0, 2], [1, 2], [0], [1], [2]];
const PRIMES = [1, 2654435761, 805459861];
const MAX_BITS = 2 ** 24;
const CHUNK = 65536;

/**
 * The block with R-10.6-1 and R-10.6-2.
 * @param {Uint8Array} bytes
 * @param {number} offset in the file
 * @returns {Grid}
 */
export function readGrid(bytes, offset) {
  const reader = new Reader(bytes, offset);
  const origin = [reader.varint(32), reader.varint(32), reader.varint(32)];
  const extentBits = reader.varint(32);
  const heads = Array.from({ length: reader.count(16) }, () => ({
    plane: reader.varint(32),
    resolution: reader.varint(32),
    tableLog2: reader.varint(32),
    features: reader.varint(32),
  }));
  const bad = (/** @type {boolean} */ holds, /** @type {string} */ what) => reader.demand(holds, "bad-grid", what);
  bad(extentBits <= 32 && heads.length >= 1, "extent or number of levels");
  for (const { plane, resolution, tableLog2, features } of heads) {
    bad(plane <= 6, `plane ${plane}`);
    bad(resolution >= 1 && resolution <= 65535, `resolution ${resolution}`);
    bad(tableLog2 >= 1 && tableLog2 <= 19 && features >= 1 && features <= 8, "size of a level");
  }
  const shapes = heads.map((head) => {
    const vertices = (head.resolution + 1) ** PLANES[head.plane].length;
    const dense = vertices <= 2 ** head.tableLog2;
    return { ...head, axes: PLANES[head.plane], dense, entries: dense ? vertices : 2 ** head.tableLog2 };
  });
  const total = shapes.reduce((sum, { entries, features }) => sum + entries * features, 0);
  bad(total <= MAX_BITS, `${total} bits`);
  const levels = shapes.map((shape) => ({ ...shape, bits: readBits(reader, shape.entries * shape.features) }));
  reader.end();
  return { origin, extentBits, levels, features: levels.reduce((sum, { features }) => sum + features, 0) };
}

/**
 * The stream of a level.
 * @param {Reader} reader
 * @param {number} n
 * @returns {Uint8Array} (n)
 */
function readBits(reader, n) {
  const ones = reader.u8();
  reader.demand(ones !== 0, "bad-grid", "a level without bits 1");
  const length = reader.u32();
  const offset = reader.offset;
  const stream = new RansStream(reader.take(length), offset);
  const table = new Table(null, cumulativeFrequencies([256 - ones, ones]));
  const bits = new Uint8Array(n);
  const part = new Int32Array(Math.min(CHUNK, n));
  for (let at = 0; at < n; at += CHUNK) {
    const some = Math.min(CHUNK, n - at);
    stream.read(table, some, part);
    bits.set(part.subarray(0, some), at);
  }
  stream.seal();
  return bits;
}

/**
 * R-10.6-3 for one lattice point.
 * @param {Grid} grid
 * @param {ArrayLike<number>} point (3), below 2^32
 * @param {Int32Array} out
 * @param {number} at where the F features go
 */
export function gridFeatures(grid, point, out, at) {
  const side = 2 ** grid.extentBits;
  for (const level of grid.levels) {
    const { axes, resolution } = level;
    const D = axes.length;
    const cells = [0, 0, 0];
    const parts = [0, 0, 0];
    for (let d = 0; d < D; d++) {
      const q = clamp(point[axes[d]] - grid.origin[axes[d]], 0, side - 1);
      const x = q * resolution;
      cells[d] = Math.floor(x / side);
      parts[d] = Math.floor((x * 256) / side) % 256;
    }
    const sums = vertexSums(level, cells, parts);
    for (let f = 0; f < level.features; f++) out[at++] = clamp(roundShift(sums[f], 8 * D - 7), -127, 127);
  }
}

/**
 * @param {Level} level
 * @param {number[]} cells
 * @param {number[]} parts 0..255
 * @returns {number[]} (features), of magnitude at most 2^24
 */
function vertexSums({ axes, resolution, tableLog2, features, dense, bits }, cells, parts) {
  const sums = new Array(features).fill(0);
  for (let vertex = 0; vertex < 1 << axes.length; vertex++) {
    let weight = 1;
    let entry = 0;
    for (let d = 0, scale = 1; d < axes.length; d++, scale *= resolution + 1) {
      const up = (vertex >> d) & 1;
      weight *= up === 1 ? parts[d] : 256 - parts[d];
      const n = cells[d] + up;
      entry = dense ? entry + n * scale : entry ^ Math.imul(n, PRIMES[d]);
    }
    if (!dense) entry &= 2 ** tableLog2 - 1;
    for (let f = 0; f < features; f++) sums[f] += bits[entry * features + f] === 1 ? weight : -weight;
  }
  return sums;
}

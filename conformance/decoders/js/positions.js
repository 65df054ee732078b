/** Local codes of the anchors that appear (SPEC §7.2). A code, below 2^63, is kept as two halves of 32 bits. */

import { demand } from "./errors.js";

/**
 * @typedef {import("./groups.js").Groups} Groups
 * @typedef {{high: Uint32Array, low: Uint32Array}} Codes one code an anchor
 * @typedef {{size: number, start: Uint32Array, count: Uint32Array, high: Uint32Array, low: Uint32Array}} Nodes
 */

const LARGEST_COUNTED = 16;
const CHUNK_BITS = 12;

/** @param {number} capacity @returns {Nodes} */
function makeNodes(capacity) {
  const column = () => new Uint32Array(capacity);
  return { size: 0, start: column(), count: column(), high: column(), low: column() };
}

/**
 * @param {Nodes} nodes
 * @param {number} start
 * @param {number} count
 * @param {number} high
 * @param {number} low
 */
function push(nodes, start, count, high, low) {
  const i = nodes.size++;
  nodes.start[i] = start;
  nodes.count[i] = count;
  nodes.high[i] = high;
  nodes.low[i] = low;
}

/**
 * `read_positions`.
 * @param {Groups} groups of POSITIONS
 * @param {number} total anchors, at least 1
 * @param {number} b local bits an axis, 0..21
 * @returns {Codes} not descending
 */
export function readPositions(groups, total, b) {
  const codes = { high: new Uint32Array(total), low: new Uint32Array(total) };
  const open = new Uint8Array(total);
  const lower = new Uint32Array(total);
  let nodes = makeNodes(total);
  let spare = makeNodes(total);
  push(nodes, 0, total, 0, 0);
  for (let bit = 3 * b - 1; bit >= 0; bit--) {
    dropSingles(nodes, codes, open, bit + 1);
    if (nodes.size === 0) break;
    readSplits(groups, nodes.count, nodes.size, lower);
    const highBit = bit >= 32 ? 2 ** (bit - 32) : 0;
    const lowBit = bit < 32 ? 2 ** bit : 0;
    spare.size = 0;
    for (let i = 0; i < nodes.size; i++) {
      const [start, count, high, low] = [nodes.start[i], nodes.count[i], nodes.high[i], nodes.low[i]];
      if (lower[i] > 0) push(spare, start, lower[i], high, low);
      if (lower[i] < count) push(spare, start + lower[i], count - lower[i], high | highBit, low | lowBit);
    }
    [nodes, spare] = [spare, nodes];
  }
  for (let i = 0; i < nodes.size; i++) {
    const past = nodes.start[i] + nodes.count[i];
    codes.high.fill(nodes.high[i], nodes.start[i], past);
    codes.low.fill(nodes.low[i], nodes.start[i], past);
  }
  readOpenBits(groups, codes, open, 3 * b);
  return codes;
}

/**
 * Takes out nodes of one anchor, which leave `width` bits for later.
 * @param {Nodes} nodes
 * @param {Codes} codes
 * @param {Uint8Array} open
 * @param {number} width
 */
function dropSingles(nodes, codes, open, width) {
  const { size } = nodes;
  nodes.size = 0;
  for (let i = 0; i < size; i++) {
    const [start, count, high, low] = [nodes.start[i], nodes.count[i], nodes.high[i], nodes.low[i]];
    if (count > 1) {
      push(nodes, start, count, high, low);
      continue;
    }
    open[start] = width;
    codes.high[start] = high;
    codes.low[start] = low;
  }
}

/**
 * `read_splits`.
 * @param {Groups} groups
 * @param {Uint32Array} counts
 * @param {number} n nodes
 * @param {Uint32Array} lower where the counts of the lower halves go
 */
function readSplits(groups, counts, n, lower) {
  /** @type {number[][]} */
  const byCount = Array.from({ length: LARGEST_COUNTED + 2 }, () => []);
  for (let i = 0; i < n; i++) byCount[Math.min(counts[i], LARGEST_COUNTED + 1)].push(i);
  for (let count = 2; count <= LARGEST_COUNTED; count++) {
    const nodes = byCount[count];
    const values = groups.read(0, 0, count, nodes.length);
    nodes.forEach((node, i) => {
      lower[node] = values[i];
    });
  }
  readLargeSplits(groups, counts, byCount[LARGEST_COUNTED + 1], lower);
  // A negative count became a large one.
  for (let i = 0; i < n; i++) requireBetween(lower[i], counts[i]);
}

/** @param {number} value @param {number} most */
function requireBetween(value, most) {
  demand(value >= 0 && value <= most, "bad-split", `${value} of ${most} anchors`);
}

/**
 * @param {Groups} groups
 * @param {Uint32Array} counts
 * @param {number[]} nodes of more than 16 anchors
 * @param {Uint32Array} lower
 */
function readLargeSplits(groups, counts, nodes, lower) {
  if (nodes.length === 0) return;
  const bins = groups.read(0, 0, LARGEST_COUNTED + 1, nodes.length).slice(0, nodes.length);
  bins.forEach((bin) => requireBetween(bin, 15));
  /** @type {Map<number, number[]>} */
  const byWidth = new Map();
  nodes.forEach((node, i) => {
    const first = Math.ceil((bins[i] * (counts[node] + 1)) / 16);
    const width = Math.ceil(((bins[i] + 1) * (counts[node] + 1)) / 16) - first;
    lower[node] = first;
    if (width <= 1) return;
    const same = byWidth.get(width);
    if (same === undefined) byWidth.set(width, [node]);
    else same.push(node);
  });
  for (const width of [...byWidth.keys()].sort((x, y) => x - y)) {
    const same = /** @type {number[]} */ (byWidth.get(width));
    const rest = readBelow(groups, width, same.length);
    rest.forEach((value) => requireBetween(value, width - 1));
    same.forEach((node, i) => {
      lower[node] += rest[i];
    });
  }
}

/**
 * Numbers that should be below `width`.
 * @param {Groups} groups
 * @param {number} width
 * @param {number} n
 * @returns {Int32Array} (n)
 */
function readBelow(groups, width, n) {
  if (width <= 4096) return groups.uniform(width, n).slice(0, n);
  const high = groups.uniform(((width - 1) >> 12) + 1, n).slice(0, n);
  const low = groups.uniform(4096, n);
  return high.map((value, i) => (value << 12) | low[i]);
}

/**
 * The bits that single anchors left for later.
 * @param {Groups} groups
 * @param {Codes} codes
 * @param {Uint8Array} open bits left of each
 * @param {number} most
 */
function readOpenBits(groups, codes, open, most) {
  /** @type {number[][]} */
  const byWidth = Array.from({ length: most + 1 }, () => []);
  open.forEach((width, a) => {
    if (width > 0) byWidth[width].push(a);
  });
  for (let width = most; width >= 1; width--) {
    const anchors = byWidth[width];
    if (anchors.length === 0) continue;
    for (let at = CHUNK_BITS * Math.floor((width - 1) / CHUNK_BITS); at >= 0; at -= CHUNK_BITS) {
      const values = groups.uniform(2 ** Math.min(CHUNK_BITS, width - at), anchors.length);
      for (let i = 0; i < anchors.length; i++) {
        const a = anchors[i];
        if (at >= 32) {
          codes.high[a] |= values[i] << (at - 32);
        } else {
          codes.low[a] |= values[i] << at;
          if (at > 32 - CHUNK_BITS) codes.high[a] |= values[i] >>> (32 - at);
        }
      }
    }
  }
}

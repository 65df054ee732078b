/** Huffman-coded literals of Zstandard, RFC 8878 §4.2. */

import { BackwardBits, badFrame, readFseTable } from "./fse.js";

const MAX_BITS = 11;

/**
 * The next `log` bits, as an index, give a symbol and how many bits it takes.
 * @typedef {{log: number, symbol: Uint8Array, bits: Uint8Array}} HuffmanTable
 */

/**
 * @param {Uint8Array} bytes
 * @param {number} at
 * @returns {{table: HuffmanTable, end: number}}
 */
export function readHuffmanTable(bytes, at) {
  if (at >= bytes.length) badFrame("no Huffman tree");
  const head = bytes[at++];
  const end = at + (head < 128 ? head : (head - 126) >> 1);
  if (end > bytes.length) badFrame("a Huffman tree is cut");
  const part = bytes.subarray(at, end);
  const weights = head < 128 ? compressedWeights(part) : Array.from({ length: head - 127 }, (_, i) => nibble(part, i));
  return { table: makeHuffmanTable(weights), end };
}

/**
 * @param {Uint8Array} bytes
 * @param {number} i
 */
function nibble(bytes, i) {
  return i % 2 === 0 ? bytes[i >> 1] >> 4 : bytes[i >> 1] & 15;
}

/**
 * Weights coded by two interleaved FSE states, until the bits are used up.
 * @param {Uint8Array} bytes
 * @returns {number[]}
 */
function compressedWeights(bytes) {
  const { table, end } = readFseTable(bytes, 0, 6, 255);
  const bits = new BackwardBits(bytes.subarray(end));
  const states = [bits.read(table.log), bits.read(table.log)];
  if (bits.left < 0) badFrame("the states of a Huffman tree are cut");
  /** @type {number[]} */
  const weights = [];
  for (let turn = 0; ; turn ^= 1) {
    if (weights.length > 253) badFrame("a Huffman tree of too many symbols");
    const state = states[turn];
    weights.push(table.symbol[state]);
    states[turn] = table.base[state] + bits.read(table.bits[state]);
    if (bits.left < 0) {
      weights.push(table.symbol[states[turn ^ 1]]);
      return weights;
    }
  }
}

/**
 * @param {number[]} weights of all symbols but the last, whose weight completes the tree
 * @returns {HuffmanTable}
 */
function makeHuffmanTable(weights) {
  let sum = 0;
  for (const weight of weights) {
    if (weight > MAX_BITS) badFrame("a Huffman weight above 11");
    sum += weight > 0 ? 1 << (weight - 1) : 0;
  }
  if (sum === 0) badFrame("a Huffman tree without symbols");
  const log = 32 - Math.clz32(sum);
  const rest = (1 << log) - sum;
  if (log > MAX_BITS || (rest & (rest - 1)) !== 0) badFrame("a Huffman tree that is not complete");
  const all = [...weights, 32 - Math.clz32(rest)];
  const symbol = new Uint8Array(1 << log);
  const bits = new Uint8Array(1 << log);
  let at = 0;
  for (let weight = 1; weight <= log; weight++) {
    for (let s = 0; s < all.length; s++) {
      if (all[s] !== weight) continue;
      const past = at + (1 << (weight - 1));
      symbol.fill(s, at, past);
      bits.fill(log + 1 - weight, at, past);
      at = past;
    }
  }
  return { log, symbol, bits };
}

/**
 * @param {HuffmanTable} table
 * @param {Uint8Array} bytes one bit stream
 * @param {Uint8Array} out filled exactly
 */
export function readHuffmanStream(table, bytes, out) {
  const bits = new BackwardBits(bytes);
  for (let i = 0; i < out.length; i++) {
    const index = bits.peek(table.log);
    out[i] = table.symbol[index];
    bits.left -= table.bits[index];
    if (bits.left < 0) badFrame("Huffman codes are cut");
  }
  if (bits.left !== 0) badFrame("bits after the last Huffman code");
}

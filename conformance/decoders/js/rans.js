/** rANS streams (SPEC §8.2). The state, below 2^64, is kept as two halves of 32 bits. */

import { demand, Refused } from "./errors.js";

/** @typedef {import("./tables.js").Table} Table */

const SLOT_MASK = 0xffffff;

export class RansStream {
  /**
   * Opens a stream: R-8.2-1.
   * @param {Uint8Array} bytes
   * @param {number | null} [offset] in the file
   */
  constructor(bytes, offset = null) {
    this.offset = offset;
    demand(bytes.length % 4 === 0, "rans-length", `a stream of ${bytes.length} bytes`, offset);
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    this.words = new Uint32Array(bytes.length / 4);
    for (let i = 0; i < this.words.length; i++) this.words[i] = view.getUint32(4 * i, true);
    this.left = this.words.length;
    demand(this.left === 0 || this.words[this.left - 1] !== 0, "rans-last-word", "the last word is 0", offset);
    this.high = 0;
    this.low = 0;
    this.#refill();
    this.#refill();
  }

  #refill() {
    if (this.high !== 0 || this.left === 0) return;
    this.high = this.low;
    this.low = this.words[--this.left];
  }

  /** R-8.2-2. */
  seal() {
    const sealed = this.high === 0 && this.low === 0 && this.left === 0;
    demand(sealed, "rans-seal", "a stream does not end with its last symbol", this.offset);
  }

  /** The low 24 bits of the state. */
  get slot() {
    return this.low & SLOT_MASK;
  }

  /**
   * The step of the state after the symbol of the slot.
   * @param {number} start c_s
   * @param {number} frequency f_s
   */
  advance(start, frequency) {
    const slot = this.low & SLOT_MASK;
    const top = frequency * (this.high >>> 16);
    const rest = frequency * (this.high & 0xffff) * 256 + frequency * (this.low >>> 24) + (slot - start);
    const sum = rest + (top % 256) * 2 ** 24;
    this.high = (Math.floor(top / 256) + Math.floor(sum / 2 ** 32)) >>> 0;
    this.low = sum >>> 0;
    this.#refill();
  }

  /**
   * The values of the next n symbols of a table.
   * @param {Table} table
   * @param {number} n
   * @param {Int32Array} out
   */
  read(table, n, out) {
    const { values, cumulative, size } = table;
    if (size === 1) {
      out.fill(values === null ? 0 : values[0], 0, n);
      return;
    }
    const buckets = table.bucketsFor(n);
    const words = this.words;
    let { high, low, left } = this;
    for (let i = 0; i < n; i++) {
      const slot = low & SLOT_MASK;
      let symbol = buckets === null ? 0 : buckets[slot >>> 12];
      let last = buckets === null ? size - 1 : buckets[(slot >>> 12) + 1];
      while (symbol < last) {
        const middle = (symbol + last + 1) >>> 1;
        if (cumulative[middle] <= slot) symbol = middle;
        else last = middle - 1;
      }
      out[i] = symbol;
      const start = cumulative[symbol];
      const frequency = cumulative[symbol + 1] - start;
      // frequency * (state >> 24) + slot - start, of which each part below is an integer below 2^50.
      const top = frequency * (high >>> 16);
      const topHigh = Math.floor(top * 0.00390625);
      const rest = frequency * (high & 0xffff) * 256 + frequency * (low >>> 24) + (slot - start);
      const sum = rest + (top - topHigh * 256) * 16777216;
      const carry = Math.floor(sum * 2.3283064365386963e-10);
      high = (topHigh + carry) >>> 0;
      low = (sum - carry * 4294967296) >>> 0;
      if (high === 0 && left > 0) {
        high = low;
        low = words[--left];
      }
    }
    this.high = high;
    this.low = low;
    this.left = left;
    if (values !== null) for (let i = 0; i < n; i++) out[i] = values[out[i]];
  }
}

/**
 * @param {Table | null} table
 * @param {string} what
 * @returns {Table} R-8.3-3
 */
export function requireTable(table, what) {
  if (table === null) throw new Refused("missing-table", `no table of ${what}`);
  return table;
}

/** Finite state entropy of Zstandard, RFC 8878 §4.1, and the two directions in which its bits are read. */

import { Refused } from "./errors.js";

/** @param {string} message @returns {never} */
export function badFrame(message) {
  throw new Refused("bad-zstd", message);
}

/** Bits of bytes from the first on, least significant first. Bits past the end are 0. */
export class ForwardBits {
  /** @param {Uint8Array} bytes */
  constructor(bytes) {
    this.bytes = bytes;
    this.at = 0;
  }

  /** @param {number} n at most 17 */
  read(n) {
    const byte = this.at >> 3;
    const { bytes } = this;
    const word = (bytes[byte] ?? 0) | ((bytes[byte + 1] ?? 0) << 8) | ((bytes[byte + 2] ?? 0) << 16);
    const value = (word >> (this.at & 7)) & ((1 << n) - 1);
    this.at += n;
    return value;
  }
}

/** Bits of bytes from the last on, after a mark of one bit 1. `left` is below 0 once more are read than there are. */
export class BackwardBits {
  /** @param {Uint8Array} bytes */
  constructor(bytes) {
    this.bytes = bytes;
    const last = bytes.length > 0 ? bytes[bytes.length - 1] : 0;
    if (last === 0) badFrame("a bit stream without its end mark");
    this.left = bytes.length * 8 - 8 + (31 - Math.clz32(last));
  }

  /** @param {number} n at most 31 */
  read(n) {
    this.left -= n;
    return this.#bits(this.left, n);
  }

  /** The next n bits, which stay. @param {number} n at most 31 */
  peek(n) {
    return this.#bits(this.left - n, n);
  }

  /**
   * @param {number} start
   * @param {number} n
   * @returns {number}
   */
  #bits(start, n) {
    if (start < 0) return start + n <= 0 ? 0 : this.#bits(0, start + n) * 2 ** -start;
    const { bytes } = this;
    const byte = start >> 3;
    const shift = start & 7;
    const word = bytes[byte] | (bytes[byte + 1] << 8) | (bytes[byte + 2] << 16);
    if (n <= 16) return (word >> shift) & ((1 << n) - 1);
    const high = (bytes[byte + 3] ?? 0) + (bytes[byte + 4] ?? 0) * 256;
    return Math.floor((word + high * 2 ** 24) / 2 ** shift) % 2 ** n;
  }
}

/**
 * State s stands for `symbol[s]`; the next is `base[s]` plus `bits[s]` bits.
 * @typedef {{log: number, symbol: Uint8Array, bits: Uint8Array, base: Uint16Array}} FseTable
 */

/**
 * @param {Uint8Array} bytes
 * @param {number} at where the description starts
 * @param {number} maxLog
 * @param {number} maxSymbol
 * @returns {{table: FseTable, end: number}}
 */
export function readFseTable(bytes, at, maxLog, maxSymbol) {
  const bits = new ForwardBits(bytes.subarray(at));
  const log = bits.read(4) + 5;
  if (log > maxLog) badFrame(`an FSE table of ${log} bits`);
  /** @type {number[]} */
  const counts = [];
  let remaining = 1 << log;
  while (remaining > 0) {
    if (counts.length > maxSymbol) badFrame("an FSE table of too many symbols");
    const count = readCount(bits, remaining);
    remaining -= Math.abs(count);
    counts.push(count);
    if (count !== 0) continue;
    for (let more = 3; more === 3; ) {
      more = bits.read(2);
      for (let i = 0; i < more; i++) counts.push(0);
      if (counts.length > maxSymbol + 1) badFrame("an FSE table of too many symbols");
    }
  }
  const end = at + Math.ceil(bits.at / 8);
  if (end > bytes.length) badFrame("an FSE table is cut");
  return { table: makeFseTable(counts, log), end };
}

/**
 * @param {ForwardBits} bits
 * @param {number} remaining at least 1
 * @returns {number} a count of at most `remaining`, or -1 for "less than one"
 */
function readCount(bits, remaining) {
  const width = 32 - Math.clz32(remaining + 1);
  const half = 1 << (width - 1);
  const short = 2 * half - 1 - (remaining + 1);
  const low = bits.read(width - 1);
  if (low < short) return low - 1;
  return (bits.read(1) === 1 ? low + half - short : low) - 1;
}

/**
 * @param {ArrayLike<number>} counts per symbol, -1 for "less than one"; magnitudes sum to 2^log
 * @param {number} log
 * @returns {FseTable}
 */
export function makeFseTable(counts, log) {
  const size = 1 << log;
  const symbol = new Uint8Array(size);
  const next = new Uint16Array(counts.length);
  let high = size - 1;
  for (let s = 0; s < counts.length; s++) {
    next[s] = Math.abs(counts[s]);
    if (counts[s] === -1) symbol[high--] = s;
  }
  const step = (size >> 1) + (size >> 3) + 3;
  for (let s = 0, at = 0; s < counts.length; s++) {
    for (let i = 0; i < counts[s]; i++) {
      symbol[at] = s;
      do at = (at + step) & (size - 1);
      while (at > high);
    }
  }
  const bits = new Uint8Array(size);
  const base = new Uint16Array(size);
  for (let state = 0; state < size; state++) {
    const number = next[symbol[state]]++;
    bits[state] = log - (31 - Math.clz32(number));
    base[state] = (number << bits[state]) - size;
  }
  return { log, symbol, bits, base };
}

/** The table of one symbol, which takes no bits. @param {number} symbol @returns {FseTable} */
export function constantFseTable(symbol) {
  return { log: 0, symbol: Uint8Array.of(symbol), bits: new Uint8Array(1), base: new Uint16Array(1) };
}

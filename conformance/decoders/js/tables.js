/** Frequency tables and TABLES blocks (SPEC §8.1, §8.3). */

import { Reader } from "./bytes.js";
import { decompress } from "./zstd.js";

const TOTAL = 2 ** 24;
const MAX_CONTENT = 64 * 2 ** 20;
const BUCKETS = 4096;
const WORTH_BUCKETS = 256;

/** A table of n symbols: their values, and the cumulative frequencies c_0 .. c_n. */
export class Table {
  /**
   * @param {Int32Array | null} values (n) of the alphabet; null where symbol i stands for i
   * @param {Uint32Array} cumulative (n + 1), 0 .. 2^24
   */
  constructor(values, cumulative) {
    this.values = values;
    this.cumulative = cumulative;
    this.size = cumulative.length - 1;
    /** @type {Uint16Array | null} */
    this.buckets = null;
    this.used = 0;
  }

  /** Frequencies f_0 .. f_(n-1). @returns {Uint32Array} */
  frequencies() {
    return Uint32Array.from({ length: this.size }, (_, i) => this.cumulative[i + 1] - this.cumulative[i]);
  }

  /**
   * The symbol of the first slot of each of 4096 ranges of slots, once so many symbols are read that it pays.
   * @param {number} n symbols about to be read
   * @returns {Uint16Array | null} (4097)
   */
  bucketsFor(n) {
    this.used += n;
    if (this.buckets === null && this.used >= WORTH_BUCKETS) this.buckets = this.#makeBuckets();
    return this.buckets;
  }

  #makeBuckets() {
    const { cumulative, size } = this;
    const buckets = new Uint16Array(BUCKETS + 1).fill(size - 1);
    for (let bucket = 0, symbol = 0; bucket < BUCKETS; bucket++) {
      while (cumulative[symbol + 1] <= bucket * (TOTAL / BUCKETS)) symbol++;
      buckets[bucket] = symbol;
    }
    return buckets;
  }
}

/**
 * §8.1.
 * @param {ArrayLike<number>} weights (n), each 1 .. 2^24 - 1
 * @returns {Uint32Array} (n + 1)
 */
export function cumulativeFrequencies(weights) {
  const n = weights.length;
  let sum = 0;
  for (let i = 0; i < n; i++) sum += weights[i];
  const cumulative = new Uint32Array(n + 1);
  // Above this bound products leave the integers that doubles hold.
  const exact = sum < 2 ** 29;
  for (let i = 0, before = 0; i <= n; before += weights[i], i++) {
    const quotient = exact
      ? Math.floor((before * (TOTAL - n)) / sum)
      : Number((BigInt(before) * BigInt(TOTAL - n)) / BigInt(sum));
    cumulative[i] = quotient + i;
  }
  return cumulative;
}

/** @type {Map<number, Table>} */
const uniformTables = new Map();

/** @param {number} n @returns {Table} of n symbols of one weight */
export function uniformTable(n) {
  let table = uniformTables.get(n);
  if (table === undefined) {
    table = new Table(null, Uint32Array.from({ length: n + 1 }, (_, i) => Math.floor((i * TOTAL) / n)));
    uniformTables.set(n, table);
  }
  return table;
}

/** @param {number} stream @param {number} component @param {number} step @param {number} context */
export function tableKey(stream, component, step, context) {
  return stream * 2 ** 24 + component * 2 ** 16 + step * 2 ** 8 + context;
}

/** The tables that one block adds. Records are checked at once, and made into tables when they are first used. */
export class TableBlock {
  /**
   * R-5.8-1 to R-5.8-4, then the records in order with R-8.3-1.
   * @param {Uint8Array} block
   */
  constructor(block) {
    this.content = decompress(block, MAX_CONTENT);
    /** Where the size of each record starts, by key. @type {Map<number, number>} */
    this.records = new Map();
    /** @type {Map<number, Table>} */
    this.made = new Map();
    const reader = new Reader(this.content);
    const count = reader.count(65536);
    for (let i = 0, before = -1; i < count; i++) {
      const key = reader.varint(32);
      reader.demand(key > before, "bad-table", "keys do not ascend");
      this.records.set(key, reader.at);
      readRecord(reader, null);
      before = key;
    }
    reader.end();
  }

  /** @param {number} key @returns {Table | null} */
  get(key) {
    const made = this.made.get(key);
    if (made !== undefined) return made;
    const at = this.records.get(key);
    if (at === undefined) return null;
    const table = makeTable(this.content, at);
    this.made.set(key, table);
    return table;
  }
}

/**
 * A record after its key. Into `out`, if given: values, then weights.
 * @param {Reader} reader
 * @param {{values: Int32Array, weights: Float64Array} | null} out
 * @returns {void}
 */
function readRecord(reader, out) {
  const size = reader.count(4096);
  reader.demand(size >= 1, "bad-table", "a table without symbols");
  let value = reader.svarint(33);
  for (let i = 0; i < size; i++) {
    if (i > 0) value += reader.varint(32) + 1;
    reader.demand(Math.abs(value) < 2 ** 31, "bad-table", `alphabet value ${value}`);
    if (out !== null) out.values[i] = value;
  }
  for (let i = 0; i < size; i++) {
    const weight = reader.varint(24);
    reader.demand(weight >= 1, "bad-table", "a weight of 0");
    if (out !== null) out.weights[i] = weight;
  }
}

/**
 * @param {Uint8Array} content
 * @param {number} at of the size of a record that was checked
 * @returns {Table}
 */
function makeTable(content, at) {
  const reader = new Reader(content.subarray(at));
  const size = reader.count(4096);
  reader.at = 0;
  const out = { values: new Int32Array(size), weights: new Float64Array(size) };
  readRecord(reader, out);
  return new Table(out.values, cumulativeFrequencies(out.weights));
}

/** The tables in force in a layer, R-8.3-2. */
export class TablesInForce {
  /** @param {TableBlock[]} blocks of the layers up to it that have one, first layer first */
  constructor(blocks) {
    this.blocks = [...blocks].reverse();
    /** @type {Map<number, Table | null>} */
    this.found = new Map();
  }

  /** @param {number} key @returns {Table | null} */
  get(key) {
    let table = this.found.get(key);
    if (table !== undefined) return table;
    table = null;
    for (const block of this.blocks) {
      table = block.get(key);
      if (table !== null) break;
    }
    this.found.set(key, table);
    return table;
  }
}

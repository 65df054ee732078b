/** Reading groups of symbols from one sub-stream (SPEC §7.1, §8.3). */

import { STREAM_NAMES } from "./constants.js";
import { RansStream, requireTable } from "./rans.js";
import { tableKey, uniformTable } from "./tables.js";

/**
 * @typedef {import("./tables.js").Table} Table
 * @typedef {import("./tables.js").TablesInForce} TablesInForce
 * @typedef {import("./trace.js").Trace} Trace
 * @typedef {import("./tile_block.js").SubStream} SubStream
 */

const NO_BYTES = new Uint8Array(0);

export class Groups {
  /**
   * @param {number} stream kind
   * @param {SubStream | undefined} source undefined where there is no record: an empty stream
   * @param {TablesInForce} tables
   * @param {Trace | null} trace
   */
  constructor(stream, source, tables, trace) {
    this.stream = stream;
    this.rans = new RansStream(source?.bytes ?? NO_BYTES, source?.offset ?? null);
    this.tables = tables;
    this.trace = trace;
    this.scratch = new Int32Array(0);
    this.order = new Uint32Array(0);
  }

  seal() {
    this.rans.seal();
  }

  /**
   * The next n values of the group of a key. They stay until the next call.
   * @param {number} component
   * @param {number} step
   * @param {number} context
   * @param {number} n
   * @returns {Int32Array} of n values or more
   */
  read(component, step, context, n) {
    if (n === 0) return this.scratch;
    const table = this.tables.get(tableKey(this.stream, component, step, context));
    const name = STREAM_NAMES[this.stream];
    return this.#values(requireTable(table, `${name}, ${component}, ${step}, ${context}`), n);
  }

  /**
   * @param {number} symbols
   * @param {number} n
   * @returns {Int32Array} of n values or more, which stay until the next call
   */
  uniform(symbols, n) {
    return n === 0 ? this.scratch : this.#values(uniformTable(symbols), n);
  }

  /**
   * `read_by_context`.
   * @param {number} component
   * @param {number} step
   * @param {Uint8Array} contexts (n) or more
   * @param {number} n
   * @param {Int32Array} out (n) or more
   */
  readByContext(component, step, contexts, n, out) {
    if (n === 0) return;
    if (n > this.order.length) this.order = new Uint32Array(2 * n);
    const { order } = this;
    const starts = new Uint32Array(257);
    for (let i = 0; i < n; i++) starts[contexts[i] + 1]++;
    for (let c = 0; c < 256; c++) starts[c + 1] += starts[c];
    const next = starts.slice();
    for (let i = 0; i < n; i++) order[next[contexts[i]]++] = i;
    for (let c = 0; c < 256; c++) {
      const start = starts[c];
      const size = starts[c + 1] - start;
      if (size === 0) continue;
      const values = this.read(component, step, c, size);
      for (let i = 0; i < size; i++) out[order[start + i]] = values[i];
    }
  }

  /**
   * @param {Table} table
   * @param {number} n at least 1
   */
  #values(table, n) {
    this.trace?.firstTable(STREAM_NAMES[this.stream], table);
    if (n > this.scratch.length) this.scratch = new Int32Array(2 * n);
    this.rans.read(table, n, this.scratch);
    return this.scratch;
  }
}

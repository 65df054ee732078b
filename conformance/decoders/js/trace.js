/** What the stages `context` and `frequencies` of the decoder protocol look at, collected while a layer is decoded. */

/** @typedef {import("./tables.js").Table} Table */

export class Trace {
  /** @param {(name: string, values: Int32Array) => void} onNumbers gets embeddings and context numbers */
  constructor(onNumbers) {
    this.onNumbers = onNumbers;
    /** Frequencies of the first table of each sub-stream. @type {Map<string, Uint32Array>} */
    this.frequencies = new Map();
    this.suffix = "";
  }

  /**
   * @param {string} stream
   * @param {Table} table
   */
  firstTable(stream, table) {
    const name = stream + this.suffix;
    if (!this.frequencies.has(name)) this.frequencies.set(name, table.frequencies());
  }

  /**
   * @param {string} name
   * @param {() => Uint32Array} frequencies
   */
  firstFrequencies(name, frequencies) {
    if (!this.frequencies.has(name)) this.frequencies.set(name, frequencies());
  }

  /** Names what follows `.N`, or nothing where null. @param {number | null} stage */
  atStage(stage) {
    this.suffix = stage === null ? "" : `.${stage}`;
  }
}

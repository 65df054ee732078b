/** Named arrays of an answer of the decoder protocol, which arrive tile by tile. */

import { base64 } from "./base64.js";
import { Sha256 } from "./sha256.js";

/**
 * @typedef {Uint8Array | Uint16Array | Uint32Array | Int32Array | Float32Array | Float64Array} Numbers
 * @typedef {{dtype: string, row: number[], rows: number, sha: Sha256 | null, parts: Numbers[]}} Collected
 *   row: shape without the first dimension; rows: how many so far; parts: kept where there is no sha
 */

/** Bytes of each type. @type {Record<string, number>} */
const SIZE = { "|u1": 1, "<u2": 2, "<u4": 4, "<i4": 4, "<f4": 4, "<u8": 8, "<f8": 8 };

export class NamedArrays {
  /** @param {boolean} keep the numbers themselves, not only their SHA-256 */
  constructor(keep = false) {
    this.keep = keep;
    /** @type {Map<string, Collected>} */
    this.arrays = new Map();
  }

  /**
   * An array that is present even if nothing is added.
   * @param {string} name
   * @param {string} dtype
   * @param {number[]} row shape without the first dimension
   * @returns {Collected}
   */
  declare(name, dtype, row) {
    let array = this.arrays.get(name);
    if (array === undefined) {
      array = { dtype, row, rows: 0, sha: this.keep ? null : new Sha256(), parts: [] };
      this.arrays.set(name, array);
    }
    return array;
  }

  /**
   * @param {string} name
   * @param {string} dtype
   * @param {number[]} row
   * @param {Numbers} numbers
   * @param {number} [rows] how many, where the rows may be empty
   */
  add(name, dtype, row, numbers, rows) {
    const array = this.declare(name, dtype, row);
    const width = row.reduce((product, n) => product * n, 1);
    array.rows += rows ?? numbers.byteLength / SIZE[dtype] / width;
    if (array.sha === null) array.parts.push(numbers);
    else array.sha.update(numbers);
  }

  /** `{"arrays": {...}}` in pieces. @returns {Generator<string>} */
  *json() {
    yield '{"arrays": {';
    let first = true;
    for (const [name, { dtype, row, rows, sha, parts }] of this.arrays) {
      const shape = JSON.stringify([rows, ...row]);
      yield `${first ? "" : ", "}${JSON.stringify(name)}: {"dtype": "${dtype}", "shape": ${shape}, `;
      if (sha === null) {
        yield '"data": "';
        yield* base64(parts);
      } else {
        yield `"sha256": "${sha.hex()}`;
      }
      yield '"}';
      first = false;
    }
    yield "}}";
  }
}

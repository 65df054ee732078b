/** Named arrays of an answer of the decoder protocol, which arrive tile by tile. */

import { base64 } from "./base64.js";
import { Sha256 } from "./sha256.js";

/**
 * @typedef {Uint8Array | Uint16Array | Uint32Array | Int32Array | Float32Array | Float64Array} Numbers
 * @typedef {{dtype: string, row: number[], rows: number, sha: Sha256 | null, parts: Uint8Array[]}} Collected
 *   row: shape without the first dimension; rows: how many so far; parts: kept where there is no sha
 */

/** Bytes of each type. @type {Record<string, number>} */
const SIZE = { "|u1": 1, "<u2": 2, "<u4": 4, "<i4": 4, "<f4": 4, "<u8": 8, "<f8": 8 };

const LITTLE = new Uint8Array(new Uint32Array([1]).buffer)[0] === 1;

/**
 * The bytes of numbers, each least significant first, as the protocol wants them.
 * @param {Numbers} numbers
 * @param {boolean} [swap] their bytes lie the other way round, as in a big-endian machine
 * @returns {Uint8Array} a view where nothing is to be swapped
 */
export function littleEndian(numbers, swap = !LITTLE) {
  const bytes = new Uint8Array(numbers.buffer, numbers.byteOffset, numbers.byteLength);
  const size = numbers.BYTES_PER_ELEMENT;
  if (!swap || size === 1) return bytes;
  const out = bytes.slice();
  for (let at = 0; at < out.length; at += size) out.subarray(at, at + size).reverse();
  return out;
}

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
    const bytes = littleEndian(numbers);
    if (array.sha === null) array.parts.push(bytes);
    else array.sha.update(bytes);
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

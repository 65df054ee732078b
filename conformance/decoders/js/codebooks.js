/** CODEBOOKS blocks (SPEC §7.8). */

import { Reader } from "./bytes.js";
import { readRice } from "./rice.js";

/**
 * @typedef {{number: number, size: number, dims: number, words: Int32Array}} Codebook
 *   words: (size, dims), each -65535..65535
 */

const MAX_COMPONENT = 65535;

/**
 * The block with R-7.8-1.
 * @param {Uint8Array} bytes
 * @param {number} offset in the file
 * @returns {{dims: number, books: Codebook[]}}
 */
export function readCodebooks(bytes, offset) {
  const reader = new Reader(bytes, offset);
  const dims = reader.count(64);
  reader.demand(dims >= 1, "bad-codebook", "codewords of no dimensions");
  const count = reader.count(2);
  reader.demand(count >= 1, "bad-codebook", "no codebook");
  /** @type {Codebook[]} */
  const books = [];
  for (let i = 0; i < count; i++) {
    const number = reader.u8();
    const size = reader.count(4096);
    const ascends = number <= 1 && (i === 0 || number > books[i - 1].number);
    reader.demand(ascends && size >= 1, "bad-codebook", `codebook ${number} of ${size} codewords`);
    books.push({ number, size, dims, words: readWords(reader, size, dims) });
  }
  reader.end();
  return { dims, books };
}

/**
 * @param {Reader} reader
 * @param {number} size
 * @param {number} dims
 * @returns {Int32Array} (size, dims)
 */
function readWords(reader, size, dims) {
  const words = new Int32Array(size * dims);
  for (let d = 0; d < dims; d++) {
    const components = readRice(reader, size);
    for (let i = 0; i < size; i++) {
      const fits = Math.abs(components[i]) <= MAX_COMPONENT;
      reader.demand(fits, "bad-codebook", `codeword component ${components[i]}`);
      words[i * dims + d] = components[i];
    }
  }
  return words;
}

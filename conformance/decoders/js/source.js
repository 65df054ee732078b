/** Where the bytes of a file come from. The decoder asks for ranges, so a file need not be in memory. */

/**
 * @typedef {{length: number, read: (offset: number, length: number) => Uint8Array}} Source
 *   `read` gives exactly `length` bytes; the range lies within [0, length).
 */

/**
 * @param {Uint8Array} bytes
 * @returns {Source}
 */
export function memorySource(bytes) {
  return {
    length: bytes.length,
    read: (offset, length) => bytes.subarray(offset, offset + length),
  };
}

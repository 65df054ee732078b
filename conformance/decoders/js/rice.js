/** Rice codes, SPEC §5.9. */

/** @typedef {import("./bytes.js").Reader} Reader */

const LONGEST_QUOTIENT = 255;

/**
 * `rice(n)`: n integers of -2^31..2^31 - 1.
 * @param {Reader} reader
 * @param {number} n known to be within the limits of the caller
 * @returns {Int32Array} (n)
 */
export function readRice(reader, n) {
  const k = reader.u8();
  reader.demand(k <= 31, "bad-rice", `Rice parameter ${k}`);
  const values = new Int32Array(n);
  if (n === 0) return values;
  const quotients = readQuotients(reader, n);
  const low = reader.take(Math.ceil((n * k) / 8));
  requireFillBits(reader, low, n * k);
  const scale = 2 ** k;
  let wide = false;
  for (let i = 0, bit = 0; i < n; i++, bit += k) {
    const m = quotients[i] * scale + bitsAt(low, bit, k);
    if (m >= 2 ** 32) wide = true;
    values[i] = m % 2 === 0 ? m / 2 : -(m - 1) / 2 - 1;
  }
  reader.demand(!wide, "bad-rice", "a number of 2^32 or more");
  return values;
}

/**
 * `shifted(n)`: n integers of magnitude below 2^31.
 * @param {Reader} reader
 * @param {number} n
 * @returns {Int32Array} (n)
 */
export function readShifted(reader, n) {
  const shift = reader.u8();
  reader.demand(shift <= 31, "bad-rice", `shift ${shift}`);
  const values = readRice(reader, n);
  const scale = 2 ** shift;
  for (const value of values) {
    reader.demand(Math.abs(value * scale) < 2 ** 31, "bad-rice", "a shifted number of 2^31 or more");
  }
  return values.map((value) => value * scale);
}

/**
 * The run of bits 1 before each of the next n bits 0, and the fill bits. Looks at no more than 32 * n bytes.
 * @param {Reader} reader
 * @param {number} n at least 1
 * @returns {Uint32Array} (n), each at most 255
 */
function readQuotients(reader, n) {
  const quotients = new Uint32Array(n);
  const length = Math.min(32 * n, reader.left);
  const { bytes, at: start } = reader;
  let found = 0;
  let run = 0;
  let at = start;
  let last = 0;
  for (; found < n && at < start + length; at++) {
    const byte = bytes[at];
    for (last = 7; last >= 0; last--) {
      if ((byte >> last) & 1) {
        run++;
        continue;
      }
      quotients[found++] = run;
      run = 0;
      if (found === n) break;
    }
  }
  if (found < n) {
    reader.demand(length === 32 * n, "payload-short", "a Rice code is cut");
    reader.refuse("bad-rice", "a quotient above 255");
  }
  for (const q of quotients) reader.demand(q <= LONGEST_QUOTIENT, "bad-rice", `quotient ${q}`);
  reader.demand((bytes[at - 1] & ((1 << last) - 1)) === 0, "bad-rice", "a fill bit is 1");
  reader.at = at;
  return quotients;
}

/**
 * @param {Uint8Array} bytes
 * @param {number} bit of the first, counted from the most significant of the first byte
 * @param {number} width 0..31
 * @returns {number}
 */
function bitsAt(bytes, bit, width) {
  let value = 0;
  for (let left = width; left > 0; ) {
    const inByte = 8 - (bit % 8);
    const n = Math.min(inByte, left);
    value = value * 2 ** n + ((bytes[Math.floor(bit / 8)] >> (inByte - n)) & ((1 << n) - 1));
    bit += n;
    left -= n;
  }
  return value;
}

/**
 * @param {Reader} reader
 * @param {Uint8Array} bytes
 * @param {number} used bits of them
 */
function requireFillBits(reader, bytes, used) {
  const fill = bytes.length * 8 - used;
  if (fill === 0) return;
  reader.demand((bytes[bytes.length - 1] & ((1 << fill) - 1)) === 0, "bad-rice", "a fill bit is 1");
}

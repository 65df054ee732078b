/** Reading the fields of a payload in order: little-endian numbers, varints, counts (SPEC §1, §5.7). */

import { Refused } from "./errors.js";

export class Reader {
  /**
   * @param {Uint8Array} bytes the payload
   * @param {number | null} [base] its offset in the file; null where it is no part of it, as after decompression
   */
  constructor(bytes, base = null) {
    this.bytes = bytes;
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    this.at = 0;
    this.base = base;
  }

  /** Offset in the file of the next byte, for messages. */
  get offset() {
    return this.base === null ? null : this.base + this.at;
  }

  get left() {
    return this.bytes.length - this.at;
  }

  /**
   * @param {string} id
   * @param {string} message
   * @returns {never}
   */
  refuse(id, message) {
    throw new Refused(id, message, this.offset);
  }

  /**
   * @param {boolean} holds
   * @param {string} id
   * @param {string} message
   */
  demand(holds, id, message) {
    if (!holds) this.refuse(id, message);
  }

  /** Passes over n bytes. @param {number} n @returns {number} where they start */
  skip(n) {
    if (n > this.left) this.refuse("payload-short", `${n} bytes wanted, ${this.left} left`);
    const start = this.at;
    this.at += n;
    return start;
  }

  /** @param {number} n @returns {Uint8Array} the next n bytes, not copied */
  take(n) {
    const start = this.skip(n);
    return this.bytes.subarray(start, start + n);
  }

  u8() {
    return this.bytes[this.skip(1)];
  }

  u32() {
    return this.view.getUint32(this.skip(4), true);
  }

  f32() {
    return this.view.getFloat32(this.skip(4), true);
  }

  f64() {
    return this.view.getFloat64(this.skip(8), true);
  }

  /**
   * §5.7. Exact below 2^53; above, a double near the value, which no caller accepts.
   * @param {number} bits at most 63
   */
  varint(bits) {
    let value = 0;
    let scale = 1;
    for (let shift = 0; ; shift += 7) {
      const byte = this.u8();
      value += (byte & 0x7f) * scale;
      scale *= 128;
      if (byte < 0x80) {
        const room = bits - shift;
        const tooLarge = room < 7 && byte >> room !== 0;
        if (tooLarge || (byte === 0 && shift > 0)) this.refuse("bad-varint", `not a varint(${bits})`);
        return value;
      }
      if (shift + 7 > bits) this.refuse("bad-varint", `a varint(${bits}) that is too long`);
    }
  }

  /** The same, exact however large. @param {number} bits at most 63 @returns {bigint} */
  bigVarint(bits) {
    const start = this.at;
    const near = this.varint(bits);
    if (near < 2 ** 53) return BigInt(near);
    let value = 0n;
    for (let i = this.at - 1; i >= start; i--) value = (value << 7n) | BigInt(this.bytes[i] & 0x7f);
    return value;
  }

  /** @param {number} bits at most 53 */
  svarint(bits) {
    const m = this.varint(bits);
    return m % 2 === 0 ? m / 2 : -(m - 1) / 2 - 1;
  }

  /** @param {number} most */
  count(most) {
    const value = this.varint(63);
    if (value > most) this.refuse("count-limit", `a count of ${value}, at most ${most} allowed`);
    return value;
  }

  /** R-5.7-2: the structure fills its payload. */
  end() {
    if (this.left > 0) this.refuse("payload-long", `${this.left} bytes after the end of the structure`);
  }
}

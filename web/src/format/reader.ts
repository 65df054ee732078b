/** Reading the fields of a payload in order: little-endian numbers, varints (SPEC §1, §5.7). */

import { Refused } from "./errors.js";

export class Reader {
  readonly #view: DataView;
  #at = 0;

  /**
   * @param bytes the payload
   * @param base its offset in the file
   */
  constructor(
    readonly bytes: Uint8Array,
    readonly base = 0,
  ) {
    this.#view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  }

  /** Offset in the file of the next byte. */
  get offset(): number {
    return this.base + this.#at;
  }

  get left(): number {
    return this.bytes.length - this.#at;
  }

  refuse(id: string, message: string): never {
    throw new Refused(id, message, this.offset);
  }

  demand(holds: boolean, id: string, message: string): void {
    if (!holds) this.refuse(id, message);
  }

  /** @returns the next n bytes, not copied */
  take(n: number): Uint8Array {
    const start = this.#skip(n);
    return this.bytes.subarray(start, start + n);
  }

  u8(): number {
    return this.bytes[this.#skip(1)];
  }

  u32(): number {
    return this.#view.getUint32(this.#skip(4), true);
  }

  f32(): number {
    return this.#view.getFloat32(this.#skip(4), true);
  }

  /**
   * §5.7. Exact below 2^53; above, a double near the value, which no caller accepts.
   * @param bits at most 63
   */
  varint(bits: number): number {
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

  /** The same, exact however large. @param bits at most 63 */
  bigVarint(bits: number): bigint {
    const start = this.#at;
    const near = this.varint(bits);
    if (near < 2 ** 53) return BigInt(near);
    let value = 0n;
    for (let i = this.#at - 1; i >= start; i--) value = (value << 7n) | BigInt(this.bytes[i] & 0x7f);
    return value;
  }

  /** R-5.7-2: the structure fills its payload. */
  end(): void {
    if (this.left > 0) this.refuse("payload-long", `${this.left} bytes after the end of the structure`);
  }

  /** Passes over n bytes. @returns where they start */
  #skip(n: number): number {
    if (n > this.left) this.refuse("payload-short", `${n} bytes wanted, ${this.left} left`);
    this.#at += n;
    return this.#at - n;
  }
}

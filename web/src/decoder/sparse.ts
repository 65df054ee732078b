/** The bytes of a file that have arrived, at their offsets: what the JavaScript decoder reads from. */

/** Ranges of a file that is mostly not there. */
export class SparseSource {
  readonly #parts = new Map<number, Uint8Array>();

  /** @param length of the whole file */
  constructor(readonly length: number) {}

  put(offset: number, bytes: Uint8Array): void {
    this.#parts.set(offset, bytes);
  }

  remove(offset: number): void {
    this.#parts.delete(offset);
  }

  /** Bytes held. */
  get held(): number {
    let sum = 0;
    for (const { length } of this.#parts.values()) sum += length;
    return sum;
  }

  /** A range that lies within one part; RangeError if it does not. */
  read(offset: number, length: number): Uint8Array {
    const exact = this.#parts.get(offset);
    if (exact !== undefined && exact.length >= length) return exact.subarray(0, length);
    for (const [at, part] of this.#parts) {
      if (at <= offset && offset + length <= at + part.length) return part.subarray(offset - at, offset - at + length);
    }
    throw new RangeError(`bytes ${offset} to ${offset + length} have not arrived`);
  }
}

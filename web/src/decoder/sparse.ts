/** The bytes of a file that have arrived, at their offsets: what the JavaScript decoder reads from. */

const FILE_LENGTH_AT = 16;
const FILE_LENGTH_END = 24;

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

/**
 * A source that holds the first bytes of a file.
 * @param size of the file; what its header says where that is not known
 */
export function startOf(bytes: Uint8Array, size: number | null = null): SparseSource {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const declared = bytes.length < FILE_LENGTH_END ? bytes.length : Number(view.getBigUint64(FILE_LENGTH_AT, true));
  const source = new SparseSource(size ?? declared);
  source.put(0, bytes);
  return source;
}

/** Whole pages and blocks out of bytes that pass. */

import { crc32 } from "../format/crc32.js";
import type { Entries } from "../format/directory.js";

/** The first bytes of a block whose others have not come. */
export interface Partial {
  entry: number;
  /** Room for the whole block. */
  body: Uint8Array;
  filled: number;
}

/** Cuts a run of bytes of a file into its pages and blocks, called blocks here. Bytes of blocks that are not wanted are let go. */
export class Assembler {
  #entry: number;
  #body: Uint8Array | null = null;
  #filled = 0;
  #at: number;

  /**
   * @param start byte of the file at which the run begins
   * @param wants asked when a block begins
   * @param take gets each wanted block; null where its CRC is wrong (R-5.5-1, R-5.6-1)
   * @param partial the block in which the run begins, where it is not a new one
   */
  constructor(
    readonly entries: Entries,
    start: number,
    readonly wants: (entry: number) => boolean,
    readonly take: (entry: number, body: Uint8Array | null) => void,
    partial?: Partial,
  ) {
    this.#at = start;
    this.#entry = partial?.entry ?? firstFrom(entries.offset, start);
    this.#body = partial?.body ?? null;
    this.#filled = partial?.filled ?? 0;
  }

  /** The block in whose midst the run is now, null if in none. */
  get unfinished(): Partial | null {
    return this.#body === null ? null : { entry: this.#entry, body: this.#body, filled: this.#filled };
  }

  /** Byte of the file that comes next. */
  get position(): number {
    return this.#at;
  }

  push(chunk: Uint8Array): void {
    const { offset, length } = this.entries;
    let from = 0;
    while (from < chunk.length && this.#entry < offset.length) {
      const e = this.#entry;
      // What is not there, or of a page that is not open, is not cut out.
      if (length[e] === 0) {
        this.#entry++;
        continue;
      }
      if (this.#at < offset[e]) {
        const skipped = Math.min(chunk.length - from, offset[e] - this.#at);
        from += skipped;
        this.#at += skipped;
        continue;
      }
      if (this.#at === offset[e]) {
        this.#body = this.wants(e) ? new Uint8Array(length[e]) : null;
      }
      const taken = Math.min(chunk.length - from, length[e] - this.#filled);
      this.#body?.set(chunk.subarray(from, from + taken), this.#filled);
      this.#filled += taken;
      from += taken;
      this.#at += taken;
      if (this.#filled === length[e]) this.#finish(e);
    }
    this.#at += chunk.length - from;
  }

  #finish(e: number): void {
    const body = this.#body;
    this.#body = null;
    this.#filled = 0;
    this.#entry++;
    if (body !== null) this.take(e, crc32(body) === this.entries.crc32[e] ? body : null);
  }
}

/** The first entry that begins at a byte or after it; offsets ascend. */
export function firstFrom(offset: Float64Array, start: number): number {
  let low = 0;
  let high = offset.length;
  while (low < high) {
    const middle = (low + high) >>> 1;
    if (offset[middle] < start) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** Reading the front of a file with as few requests as it takes: one, unless the directory is large. */

import { type Directory, frontLength, openPages, parseFront } from "../format/directory.js";
import { directoryEnd, MOST_HEADER } from "../format/header.js";
import { StreamError } from "./errors.js";
import type { Body, ByteSource } from "./source.js";

/** How a front is read, bytes. */
export interface FrontSizes {
  /** What is asked for first, at least a header: 32 KiB, front, first models and small picture of most files, unless given. */
  firstBytes: number;
  /**
   * Pages are read before anything else as long as they end here, 256 KiB unless given; of a larger directory those that
   * the plan needs.
   */
  frontBytes: number;
}

export const FRONT_SIZES: FrontSizes = { firstBytes: 32 * 1024, frontBytes: 256 * 1024 };

export interface OpenedFront {
  front: Directory;
  /** Header and ROOT. */
  bytes: Uint8Array;
  /** Where the bytes end that were looked at: every page before is open. */
  position: number;
  /** What comes after them in the answer to the last request: bytes read so far, then the body. */
  rest: Uint8Array;
  body: Body;
  /** One past the last byte that the body brings. */
  end: number;
  requests: number;
  /** Bytes read so far. */
  read: number;
}

/** Throws StreamError, refusals of §5, or the reason of the signal. */
export async function openFront(source: ByteSource, signal: AbortSignal, sizes = FRONT_SIZES): Promise<OpenedFront> {
  const asked = Math.min(sizes.firstBytes, source.size ?? sizes.firstBytes);
  const beginning = new Beginning(source, signal, await source.open(0, asked, signal), asked);
  try {
    await beginning.fill(MOST_HEADER);
    const known = source.size ?? (beginning.ended ? beginning.length : null);
    const length = frontLength(beginning.start(MOST_HEADER), known);
    await beginning.reach(length);
    const bytes = beginning.start(length);
    const front = parseFront(bytes, source.size);
    const position = source.ranged === false ? directoryEnd(front.layers) : readAtOnce(front, length, { ...sizes, firstBytes: asked });
    await beginning.reach(position);
    openPages(front, beginning.start(position));
    const { file_length } = front.header;
    const end = source.ranged === false ? file_length : Math.max(Math.min(asked, file_length), position);
    const { body, requests, length: read } = beginning;
    return { front, bytes, position, rest: beginning.after(position), body, end, requests, read };
  } catch (error) {
    await beginning.body.chunks.return();
    throw error;
  }
}

/** Where the part of the directory ends that is read before anything else. */
function readAtOnce({ root, layers, entries }: Directory, length: number, sizes: FrontSizes): number {
  const whole = directoryEnd(layers);
  if (whole <= sizes.firstBytes) return whole;
  const endOf = (pages: number) => (pages === 0 ? length : entries.offset[pages - 1] + entries.length[pages - 1]);
  // Tile pages, then the row pages of layer 1.
  const ends = [endOf(2 * root.pages), endOf(root.pages)];
  return ends.find((end) => end <= sizes.frontBytes) ?? length;
}

/** The first bytes of a file, as far as they were read. */
class Beginning {
  readonly #chunks: Uint8Array[] = [];
  length = 0;
  ended = false;
  requests = 1;

  /** @param asked for, one past the last byte */
  constructor(
    readonly source: ByteSource,
    readonly signal: AbortSignal,
    public body: Body,
    public asked: number,
  ) {}

  /** Reads until there are so many bytes, or the body ends. */
  async fill(length: number): Promise<void> {
    while (this.length < length && !this.ended) {
      const { done, value } = await this.body.chunks.next();
      if (done === true) {
        this.ended = true;
      } else {
        this.#chunks.push(value);
        this.length += value.length;
      }
    }
  }

  /** Reads so many bytes, which may take another request. Throws StreamError where the connection ends before. */
  async reach(needed: number): Promise<void> {
    await this.fill(needed);
    if (this.length < needed && this.source.ranged !== false && this.length === this.asked) {
      this.body = await this.source.open(this.asked, needed - this.asked, this.signal);
      this.requests++;
      this.asked = needed;
      this.ended = false;
      await this.fill(needed);
    }
    if (this.length >= needed) return;
    const message = `the connection ended at byte ${this.length}, before ${needed}, in the directory`;
    throw new StreamError("cut", message, { source: this.source.name, offset: this.length });
  }

  /** The first bytes, fewer where there are fewer. */
  start(length: number): Uint8Array {
    return this.#joined().slice(0, length);
  }

  after(length: number): Uint8Array {
    return this.#joined().subarray(length);
  }

  #joined(): Uint8Array {
    if (this.#chunks.length > 1) {
      const whole = new Uint8Array(this.length);
      let at = 0;
      for (const chunk of this.#chunks) {
        whole.set(chunk, at);
        at += chunk.length;
      }
      this.#chunks.splice(0, this.#chunks.length, whole);
    }
    return this.#chunks[0] ?? new Uint8Array(0);
  }
}

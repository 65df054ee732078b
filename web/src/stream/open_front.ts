/** Reading the front of a file with as few requests as it takes: one, unless the directory is large. */

import { StreamError } from "./errors.js";
import { frontLength, MOST_HEADER, parseFront, type ParsedFront } from "./front.js";
import type { Body, ByteSource } from "./source.js";

/** What is asked for first: front and first models of most files. */
export const FIRST_BYTES = 64 * 1024;

export interface OpenedFront {
  front: ParsedFront;
  /** The bytes of the front. */
  bytes: Uint8Array;
  /** What comes after the front in the answer to the first request: bytes read so far, then the body. */
  rest: Uint8Array;
  body: Body;
  /** One past the last byte that the body brings. */
  end: number;
  requests: number;
  /** Bytes read so far. */
  read: number;
}

/**
 * Throws StreamError, refusals of §5, or the reason of the signal.
 * @param first bytes to ask for at first, at least those of a header
 */
export async function openFront(source: ByteSource, signal: AbortSignal, first = FIRST_BYTES): Promise<OpenedFront> {
  const asked = Math.min(first, source.size ?? first);
  let body = await source.open(0, asked, signal);
  let requests = 1;
  try {
    const gathered = new Gathered();
    await gathered.fill(body, MOST_HEADER);
    const known = source.size ?? (gathered.ended ? gathered.length : null);
    const needed = frontLength(gathered.start(MOST_HEADER), known);
    await gathered.fill(body, needed);
    if (gathered.length < needed && source.ranged !== false && gathered.length === asked) {
      body = await source.open(asked, needed - asked, signal);
      requests++;
      gathered.ended = false;
      await gathered.fill(body, needed);
    }
    if (gathered.length < needed) throw cut(source, gathered.length, needed);
    const bytes = gathered.start(needed);
    const front = parseFront(bytes, source.size);
    const whole = source.ranged === false;
    const end = whole ? front.header.file_length : Math.max(Math.min(asked, front.header.file_length), needed);
    return { front, bytes, rest: gathered.after(needed), body, end, requests, read: gathered.length };
  } catch (error) {
    await body.chunks.return();
    throw error;
  }
}

function cut(source: ByteSource, offset: number, needed: number): StreamError {
  const message = `the connection ended at byte ${offset}, before the end of the directory at ${needed}`;
  return new StreamError("cut", message, { source: source.name, offset });
}

/** Chunks that were read, end to end. */
class Gathered {
  readonly #chunks: Uint8Array[] = [];
  length = 0;
  ended = false;

  /** Reads until there are so many bytes, or the body ends. */
  async fill(body: Body, length: number): Promise<void> {
    while (this.length < length && !this.ended) {
      const { done, value } = await body.chunks.next();
      if (done === true) {
        this.ended = true;
      } else {
        this.#chunks.push(value);
        this.length += value.length;
      }
    }
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

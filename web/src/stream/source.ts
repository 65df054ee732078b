/** Where the bytes of a file come from; files of the user. */

import { StreamError } from "./errors.js";

/** What a question for a range is answered with. */
export interface Body {
  /** Byte of the file with which the chunks begin: 0 where the source has no ranges. */
  offset: number;
  /** To be read to its end or returned; throws StreamError. */
  chunks: AsyncGenerator<Uint8Array, void, void>;
}

export interface ByteSource {
  /** For messages. */
  readonly name: string;
  /** Bytes of the file, null before they are known. */
  readonly size: number | null;
  /** Whether ranges are answered with ranges; null before the first answer. */
  readonly ranged: boolean | null;
  /** Throws StreamError, or the reason of the signal. */
  open(offset: number, length: number, signal: AbortSignal): Promise<Body>;
}

/** A URL, or a file of the user. */
export type SourceLike = string | URL | Blob;

const CHUNK = 1 << 20;

export class BlobSource implements ByteSource {
  readonly ranged = true;
  readonly name: string;

  constructor(readonly blob: Blob) {
    this.name = blob instanceof File ? blob.name : "a blob";
  }

  get size(): number {
    return this.blob.size;
  }

  async open(offset: number, length: number, signal: AbortSignal): Promise<Body> {
    return { offset, chunks: this.#chunks(offset, length, signal) };
  }

  async *#chunks(offset: number, length: number, signal: AbortSignal): AsyncGenerator<Uint8Array, void, void> {
    for (let at = offset; at < offset + length; at += CHUNK) {
      const part = this.blob.slice(at, Math.min(at + CHUNK, offset + length));
      signal.throwIfAborted();
      let bytes: ArrayBuffer;
      try {
        bytes = await part.arrayBuffer();
      } catch (cause) {
        // What browsers say where a file was written or removed since it was chosen.
        throw new StreamError("file-changed", "the file was changed or removed", { source: this.name, cause });
      }
      signal.throwIfAborted();
      yield new Uint8Array(bytes);
    }
  }
}

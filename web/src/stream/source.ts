/** Where the bytes of a file come from. */

import { BlobSource, FunctionSource, type RangeReader } from "./local_source.js";
import { HttpSource, type HttpOptions } from "./http_source.js";
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

/** Milliseconds without a byte after which a request is given up, unless said otherwise. */
export const STALL_MS = 10_000;

/** A URL, a file of the user, or anything that gives ranges. */
export type SourceLike = string | URL | Blob | RangeReader;

export function makeSource(source: SourceLike, options: HttpOptions): ByteSource {
  if (typeof source === "string" || source instanceof URL) return new HttpSource(String(source), options);
  if (typeof Blob !== "undefined" && source instanceof Blob) return new BlobSource(source);
  if (typeof (source as RangeReader).read === "function") return new FunctionSource(source as RangeReader, options);
  throw new StreamError("bad-source", "a source is a URL, a File or Blob, or an object with size and read");
}

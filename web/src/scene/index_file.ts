/** Where an index is, and hence its files (R-17-7). */

import { retrying, type RetryingParts } from "../stream/retrying.js";
import { StreamError } from "../stream/errors.js";
import type { ByteSource, SourceLike } from "../stream/source.js";
import { MOST_BYTES, parseScene, type SceneDocument } from "./document.js";

/** Gives the file of a `uri`. */
export type Resolve = (uri: string) => SourceLike;

/** Whether a scene is several files, by its name: that of an index ends in .json. */
export function isIndexName(name: string): boolean {
  return /\.json$/i.test(name);
}

/** Beside an index that has an address: its folder followed by the segments, without query. */
export function beside(address: string): Resolve {
  const base = new URL(address, typeof location === "undefined" ? undefined : location.href);
  const folder = base.origin + base.pathname.replace(/[^/]*$/, "");
  return (uri) => folder + uri.split("/").map(encodeURIComponent).join("/");
}

/** Throws StreamError, with the rules of SPEC §17 among its ids, or the reason of the signal. */
export async function readIndex(source: ByteSource, parts: RetryingParts): Promise<SceneDocument> {
  return parseScene(await retrying(() => readAll(source, parts.signal), parts));
}

async function readAll(source: ByteSource, signal: AbortSignal): Promise<Uint8Array> {
  const chunks: Uint8Array[] = [];
  let length = 0;
  const body = await source.open(0, source.size ?? MOST_BYTES + 1, signal);
  for await (const chunk of body.chunks) {
    length += chunk.length;
    if (length > MOST_BYTES) throw new StreamError("limit-scene", `an index of more than ${MOST_BYTES} bytes`);
    chunks.push(chunk);
  }
  if (source.size !== null && length < source.size) {
    const place = { source: source.name, offset: length };
    throw new StreamError("cut", `the connection ended at byte ${length} of ${source.size}`, place);
  }
  const whole = new Uint8Array(length);
  chunks.reduce((at, chunk) => (whole.set(chunk, at), at + chunk.length), 0);
  return whole;
}

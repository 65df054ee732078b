/** Fronts of whole files: every page open. */

import type { Directory } from "../src/stream/directory.js";
import { openPages, parseFront } from "../src/stream/front.js";

export function openedFront(bytes: Uint8Array): Directory {
  const front = parseFront(bytes, bytes.length);
  openPages(front, bytes);
  return front;
}

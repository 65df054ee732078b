/** Which decoder to use. */

import type { TileDecoder } from "./types.js";

/** Loads a decoder; its code is fetched only now. */
export async function loadDecoder(): Promise<TileDecoder> {
  const { createJsDecoder } = await import("./js.js");
  return createJsDecoder();
}

/** Which decoder to use. */

import type { TileDecoder } from "./types.js";

/** Loads a decoder; its code is fetched only now. Where there is no WebAssembly, or no module, JavaScript decodes. */
export async function loadDecoder(): Promise<TileDecoder> {
  try {
    const { createWasmDecoder, loadModule } = await import("./wasm.js");
    return createWasmDecoder(await loadModule());
  } catch {
    const { createJsDecoder } = await import("./js.js");
    return createJsDecoder();
  }
}

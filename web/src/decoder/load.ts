/** Which decoder to use. */

import { sharedModule } from "./shared_module.js";
import type { TileDecoder } from "./types.js";

/**
 * Loads a decoder; its code is fetched only now. Where there is no module, or it does not run, JavaScript decodes.
 * @param module compiled elsewhere, so that workers need not do it again; null for none
 */
export async function loadDecoder(module: Promise<WebAssembly.Module | null> = sharedModule()): Promise<TileDecoder> {
  try {
    const [{ createWasmDecoder }, compiled] = await Promise.all([import("./wasm.js"), module]);
    if (compiled !== null) return createWasmDecoder(compiled);
  } catch {
    // As where there is no module.
  }
  const { createJsDecoder } = await import("./js.js");
  return createJsDecoder();
}

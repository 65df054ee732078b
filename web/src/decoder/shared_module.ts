/** The WebAssembly module of decoders: compiled once on a page, however many workers and streams it has. */

import { moduleUrl } from "./files.js";

/** A module of one function that uses a vector. */
const WITH_SIMD = Uint8Array.from([
  ...[0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15, 253, 98, 11],
]);

/**
 * The module, compiled while it is read where the server says what it is.
 * @param from where scar.wasm lies: beside this script unless given
 * @throws Error where it cannot be fetched, or the browser lacks WebAssembly with SIMD
 */
export async function loadModule(from: string | URL = moduleUrl()): Promise<WebAssembly.Module> {
  if (typeof WebAssembly === "undefined" || !WebAssembly.validate(WITH_SIMD)) {
    throw new Error("this browser has no WebAssembly with SIMD, which decoding needs: Chrome 91, Firefox 89 and Safari 16.4 have it");
  }
  const response = await fetch(from);
  if (!response.ok) throw new Error(`${from}: status ${response.status}`);
  // Browsers refuse to compile from a body of another type.
  const streams = response.headers.get("Content-Type")?.startsWith("application/wasm") === true;
  return streams ? WebAssembly.compileStreaming(response) : WebAssembly.compile(await response.arrayBuffer());
}

let shared: Promise<WebAssembly.Module> | null = null;

/** The module for all decoders of this page; where loading failed, the next caller tries again. */
export function sharedModule(): Promise<WebAssembly.Module> {
  shared ??= loadModule().catch((error: unknown) => {
    shared = null;
    throw error;
  });
  return shared;
}

/** The WebAssembly module of decoders: compiled once on a page, however many workers and streams it has. */

/** Lies beside the scripts, whichever of them this is built into. */
const BESIDE = () => new URL("./scar.wasm", import.meta.url);

/**
 * The module, compiled while it is read where the server says what it is.
 * @param from where scar.wasm lies: beside this script if nothing else is said
 * @throws where it cannot be fetched, or the browser knows no SIMD
 */
export async function loadModule(from: string | URL = BESIDE()): Promise<WebAssembly.Module> {
  const response = await fetch(from);
  if (!response.ok) throw new Error(`${from}: status ${response.status}`);
  // Browsers refuse to compile from a body of another type.
  const streams = response.headers.get("Content-Type")?.startsWith("application/wasm") === true;
  return streams ? WebAssembly.compileStreaming(response) : WebAssembly.compile(await response.arrayBuffer());
}

let shared: Promise<WebAssembly.Module | null> | null = null;

/** The module for all decoders of this page; null where it is not to be had, and then the next who asks tries again. */
export function sharedModule(): Promise<WebAssembly.Module | null> {
  shared ??= loadModule().catch(() => (shared = null));
  return shared;
}

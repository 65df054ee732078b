/**
 * What is loaded beside the scripts, whichever of them this is built into. Bundlers find both files by these very words.
 */

export function makeWorker(): Worker {
  return new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
}

export function moduleUrl(): URL {
  return new URL("./scar.wasm", import.meta.url);
}

/** Files that the tests read: a scene of several tiles, and the vectors of the conformance suite. */

import { readFileSync } from "node:fs";
import { join } from "node:path";

/** The repository; tests run from web/. */
export const REPOSITORY = join(process.cwd(), "..");

export function readBytes(path: string): Uint8Array {
  return new Uint8Array(readFileSync(path));
}

/** 10,914 Gaussians, 24 tiles, 5 layers; test/data/README.md says how it was made. */
export const toys = () => readBytes(join(REPOSITORY, "web/test/data/toys.scar"));

export const vector = (name: string) => readBytes(join(REPOSITORY, "conformance/vectors", name, "input.scar"));

/** The module that build.mjs has made, beside the folder of the built tests. */
export const compiledModule = () => new WebAssembly.Module(readFileSync(new URL("../scar.wasm", import.meta.url)));

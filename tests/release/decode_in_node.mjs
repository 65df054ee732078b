/** Decodes a file with the installed package: `node decode_in_node.mjs FILE` writes the number of Gaussians. */

import { readFileSync } from "node:fs";
import { inlineChannel, loadModule, ScarStream, WasmDecoder } from "scar-stream";

const file = new Blob([readFileSync(process.argv[2])]);
const module = readFileSync(new URL("./scar.wasm", import.meta.resolve("scar-stream")));
const address = `data:application/wasm;base64,${module.toString("base64")}`;

const make = async () => new WasmDecoder(await loadModule(address));
const stream = new ScarStream(file, { workers: 1, channel: inlineChannel(make) });
const counts = new Map();
stream.on("error", (error) => {
  throw error;
});
stream.on("tile", ({ tile, count }) => counts.set(tile, count));
stream.on("done", () => {
  stream.close();
  console.log([...counts.values()].reduce((sum, one) => sum + one, 0));
});

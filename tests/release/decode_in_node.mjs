/** Decodes a file with the installed package, by each of its decoders: `node decode_in_node.mjs FILE` */

import { readFileSync } from "node:fs";
import { createJsDecoder, createWasmDecoder, inlineChannel, ScarStream } from "scar-stream";

const file = new Blob([readFileSync(process.argv[2])]);
const module = readFileSync(new URL("./scar.wasm", import.meta.resolve("scar-stream")));
const address = `data:application/wasm;base64,${module.toString("base64")}`;

/** Decodes all layers of all tiles and gives the number of Gaussians. */
function decoded(make) {
  return new Promise((resolve, reject) => {
    const stream = new ScarStream(file, { workers: 1, channel: inlineChannel(make) });
    const counts = new Map();
    stream.on("error", reject);
    stream.on("tile", ({ tile, count }) => counts.set(tile, count));
    stream.on("done", () => {
      const { engine } = stream.stats();
      stream.close();
      resolve({ engine, count: [...counts.values()].reduce((sum, one) => sum + one, 0) });
    });
  });
}

const js = await decoded(createJsDecoder);
const wasm = await decoded(() => createWasmDecoder(address));
console.log(JSON.stringify({ js, wasm }));

/** A decoder in a worker thread of Node, as src/decoder/worker.ts is one in a browser. */

import { parentPort } from "node:worker_threads";
import { loadDecoder } from "../src/decoder/load.js";
import { answer } from "../src/decoder/protocol.js";

const decoder = loadDecoder();
parentPort!.on("message", async (request) => {
  const { reply, transfer } = await answer(decoder, request);
  parentPort!.postMessage(reply, transfer);
});

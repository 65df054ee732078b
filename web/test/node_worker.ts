/** A decoder in a worker thread of Node, as src/decoder/worker.ts is one in a browser. */

import { parentPort } from "node:worker_threads";
import { answer } from "../src/decoder/protocol.js";
import { decoder } from "./files.js";

const own = decoder();
parentPort!.on("message", (request) => {
  const { reply, transfer } = answer(own, request);
  parentPort!.postMessage(reply, transfer);
});

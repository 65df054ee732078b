/** Worker threads of Node as channels to decoders. */

import { join } from "node:path";
import { Worker } from "node:worker_threads";
import type { MakeChannel } from "../src/decoder/channel.js";

export const threadChannel: MakeChannel = ({ onReply, onFailure }) => {
  const worker = new Worker(join(process.cwd(), "dist/tests/node_worker.mjs"));
  worker.on("message", onReply);
  worker.on("error", (error) => onFailure(error.message));
  return {
    post: (request, transfer) => worker.postMessage(request, transfer),
    close: () => void worker.terminate(),
  };
};

/** Ways to a decoder: a worker of a browser, or the calling thread. */

import { loadDecoder } from "./load.js";
import { answer, type Beginning, type Reply, type Request } from "./protocol.js";
import { sharedModule } from "./shared_module.js";
import type { MakeDecoder } from "./types.js";

export interface Channel {
  post(request: Request, transfer: ArrayBuffer[]): void;
  close(): void;
}

export interface ChannelEvents {
  onReply(reply: Reply): void;
  /** The worker cannot be loaded, or died. */
  onFailure(message: string): void;
}

export type MakeChannel = (events: ChannelEvents) => Channel;

/** Workers that have begun to load, for streams to come. */
const spare: Worker[] = [];

/** Starts workers, so that the next stream need not wait for them. */
export function prepareWorkers(count: number): void {
  while (spare.length < count) {
    const worker = startWorker();
    // Who takes it would never learn of what happened before.
    worker.onerror = () => spare.splice(spare.indexOf(worker), 1);
    spare.push(worker);
  }
}

function startWorker(): Worker {
  const worker = new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
  void sharedModule().then((module) => worker.postMessage({ module } satisfies Beginning));
  return worker;
}

/** A decoder in a module worker, whose script lies beside this one. It may be asked at once, and answers when it is there. */
export function workerChannel({ onReply, onFailure }: ChannelEvents): Channel {
  const worker = spare.pop() ?? startWorker();
  worker.onmessage = ({ data }: MessageEvent<Reply>) => onReply(data);
  worker.onerror = (event) => onFailure(event.message || "the worker could not be loaded");
  worker.onmessageerror = () => onFailure("a message of the worker could not be read");
  return {
    post: (request, transfer) => worker.postMessage(request, transfer),
    close: () => worker.terminate(),
  };
}

/** A decoder on the calling thread: where there are no workers, and for tests. */
export function inlineChannel(make: MakeDecoder = loadDecoder): MakeChannel {
  return ({ onReply }) => {
    let closed = false;
    const decoder = make();
    const work = async (request: Request) => {
      const { reply } = await answer(decoder, request);
      if (!closed) onReply(reply);
    };
    return {
      post: (request) => void work(request),
      close: () => {
        closed = true;
      },
    };
  };
}

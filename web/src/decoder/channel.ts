/** Ways to a decoder: a worker of a browser, or the calling thread. */

import { loadDecoder } from "./load.js";
import { answer, type Reply, type Request } from "./protocol.js";
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

/** A decoder in a module worker, whose script lies beside this one. */
export function workerChannel({ onReply, onFailure }: ChannelEvents): Channel {
  const worker = new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
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

/** Ways to a decoder: a worker of a browser, or the calling thread. */

import { answer, type Beginning, type Reply, type Request } from "./protocol.js";
import { makeWorker } from "./files.js";
import { sharedModule } from "./shared_module.js";
import { WasmDecoder } from "./wasm.js";

export interface Channel {
  post(request: Request, transfer: ArrayBuffer[]): void;
  close(): void;
}

export interface ChannelEvents {
  onReply(reply: Reply): void;
  /** The decoder cannot be loaded, or its worker died. */
  onFailure(message: string): void;
}

export type MakeChannel = (events: ChannelEvents) => Channel;

/** A decoder in a module worker, whose script lies beside this one. It takes requests before it is loaded. */
export function workerChannel({ onReply, onFailure }: ChannelEvents): Channel {
  const worker = makeWorker();
  const begun = sharedModule().then((module) => worker.postMessage({ module } satisfies Beginning));
  worker.onmessage = ({ data }: MessageEvent<Reply>) => onReply(data);
  worker.onerror = (event) => onFailure(event.message || "the worker could not be loaded");
  worker.onmessageerror = () => onFailure("a message of the worker could not be read");
  begun.catch((error: Error) => onFailure(error.message));
  return {
    post: (request, transfer) => worker.postMessage(request, transfer),
    close: () => worker.terminate(),
  };
}

async function loadDecoder(): Promise<WasmDecoder> {
  return new WasmDecoder(await sharedModule());
}

/** A decoder on the calling thread: where there are no workers, and for tests. */
export function inlineChannel(make: () => Promise<WasmDecoder> = loadDecoder): MakeChannel {
  return ({ onReply, onFailure }) => {
    let closed = false;
    const decoder = make();
    decoder.catch((error: Error) => closed || onFailure(error.message));
    const work = async (request: Request) => {
      const { reply } = answer(await decoder, request);
      if (!closed) onReply(reply);
    };
    return {
      post: (request) => void work(request).catch(() => undefined),
      close: () => {
        closed = true;
      },
    };
  };
}

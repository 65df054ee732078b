/** A decoder in a module worker. */

import { loadDecoder } from "./load.js";
import { answer, type Request } from "./protocol.js";

const scope = self as unknown as DedicatedWorkerGlobalScope;
const decoder = loadDecoder();

scope.onmessage = async ({ data }: MessageEvent<Request>) => {
  const { reply, transfer } = await answer(decoder, data);
  scope.postMessage(reply, transfer);
};

interface DedicatedWorkerGlobalScope {
  onmessage: ((event: MessageEvent<Request>) => void) | null;
  postMessage(message: unknown, transfer: Transferable[]): void;
}

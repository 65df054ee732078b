/** A decoder in a module worker. */

import { loadDecoder } from "./load.js";
import { answer, type Beginning, type Request } from "./protocol.js";

const scope = self as unknown as DedicatedWorkerGlobalScope;
let begin: (module: WebAssembly.Module | null) => void;
const decoder = loadDecoder(new Promise((resolve) => (begin = resolve)));

scope.onmessage = async ({ data }: MessageEvent<Beginning | Request>) => {
  if ("module" in data) return begin(data.module);
  const { reply, transfer } = await answer(decoder, data);
  scope.postMessage(reply, transfer);
};

interface DedicatedWorkerGlobalScope {
  onmessage: ((event: MessageEvent<Beginning | Request>) => void) | null;
  postMessage(message: unknown, transfer: Transferable[]): void;
}

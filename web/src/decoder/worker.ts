/** A decoder in a module worker. */

import { answer, type Beginning, type Request } from "./protocol.js";
import { WasmDecoder } from "./wasm.js";

interface WorkerScope {
  onmessage: ((event: MessageEvent<Beginning | Request>) => void) | null;
  postMessage(message: unknown, transfer: Transferable[]): void;
}

const scope = self as unknown as WorkerScope;
let begin: (module: WebAssembly.Module) => void;
const decoder = new Promise<WebAssembly.Module>((resolve) => (begin = resolve)).then((module) => new WasmDecoder(module));

scope.onmessage = async ({ data }) => {
  if ("module" in data) return begin(data.module);
  const { reply, transfer } = answer(await decoder, data);
  scope.postMessage(reply, transfer);
};

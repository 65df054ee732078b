/**
 * The decoder protocol (conformance/PROTOCOL.md) answered by the WebAssembly decoder:
 *
 *     node dist/tests/conformance.mjs FILE [--layers K] [--stage S] [--camera X,Y,Z]
 *     node dist/tests/conformance.mjs --session
 */

import { answer, CAPABILITIES } from "../../conformance/decoders/js/answers.js";
import { serve } from "../../conformance/decoders/js/protocol.js";
import { compiledModule } from "./files.js";
import { STAGES, wasmOpener } from "./wasm_scar.js";

const decoder = { open: wasmOpener(compiledModule()), decoded: STAGES };
serve({
  capabilities: { ...CAPABILITIES, decoder: "scar-stream wasm", stages: [...STAGES, "metadata", "streaming"] },
  answer: (source, question) => answer(source, question, decoder),
});

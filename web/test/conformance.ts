/**
 * The decoder protocol (conformance/PROTOCOL.md) answered by the WebAssembly decoder:
 *
 *     node dist/tests/conformance.mjs FILE [--layers K] [--stage S] [--camera X,Y,Z]
 *     node dist/tests/conformance.mjs --session
 */

import { writeSync } from "node:fs";
import { createInterface } from "node:readline";
import { parseArgs } from "node:util";
import { answer, CAPABILITIES, type Question } from "./answers.js";
import { compiledModule } from "./files.js";

const compiled = compiledModule();

function reply(question: Question): void {
  const found = question.stage === "capabilities" ? { capabilities: CAPABILITIES } : answer(compiled, question);
  const text = Buffer.from(`${JSON.stringify(found)}\n`);
  for (let at = 0; at < text.length; ) {
    try {
      at += writeSync(1, text, at);
    } catch (error) {
      // A pipe that is full.
      if ((error as NodeJS.ErrnoException).code !== "EAGAIN") throw error;
    }
  }
}

const { values, positionals } = parseArgs({
  allowPositionals: true,
  options: {
    layers: { type: "string", default: "0" },
    stage: { type: "string", default: "all" },
    camera: { type: "string" },
    session: { type: "boolean", default: false },
  },
});
if (values.session) {
  for await (const line of createInterface({ input: process.stdin, crlfDelay: Infinity })) {
    if (line.trim() !== "") reply(JSON.parse(line));
  }
} else {
  const camera = values.camera?.split(",").map(Number) as Question["camera"];
  reply({ file: positionals[0], layers: Number(values.layers), stage: values.stage, camera });
}

/** The decoder protocol (conformance/PROTOCOL.md) answered by the WebAssembly decoder: `node dist/tests/conformance.mjs --session` */

import { writeSync } from "node:fs";
import { createInterface } from "node:readline";
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

for await (const line of createInterface({ input: process.stdin, crlfDelay: Infinity })) {
  if (line.trim() !== "") reply(JSON.parse(line));
}

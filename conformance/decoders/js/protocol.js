/** The decoder protocol (PROTOCOL.md) on standard input and output, for any decoder that answers it. */

import { closeSync, fstatSync, openSync, readSync } from "node:fs";
import { createInterface } from "node:readline";
import { parseArgs } from "node:util";

/** @typedef {import("./source.js").Source} Source */
/** @typedef {{file: string, layers: number, stage: string, camera?: number[]}} Question */
/**
 * @typedef {{capabilities: object, answer: (source: Source, question: Question) => Iterable<string>}} Decoder
 *   answer: in pieces of one line of JSON
 */

const PIECE = 1 << 16;

/**
 * @param {string} path
 * @returns {Source & {close: () => void}}
 */
function fileSource(path) {
  const file = openSync(path, "r");
  const read = (/** @type {number} */ offset, /** @type {number} */ length) => {
    const bytes = new Uint8Array(length);
    for (let at = 0; at < length; ) {
      const n = readSync(file, bytes, at, length - at, offset + at);
      if (n === 0) throw new Error(`${path} became shorter while it was read`);
      at += n;
    }
    return bytes;
  };
  return { length: fstatSync(file).size, read, close: () => closeSync(file) };
}

/** @param {string} text @returns {Promise<void>} when it is written */
function write(text) {
  return new Promise((resolve, reject) => {
    process.stdout.write(text, (error) => (error ? reject(error) : resolve()));
  });
}

/** @param {Decoder} decoder @param {Question} question */
async function reply({ capabilities, answer }, question) {
  if (question.stage === "capabilities") {
    await write(`${JSON.stringify({ capabilities })}\n`);
    return;
  }
  const source = fileSource(question.file);
  try {
    let text = "";
    for (const piece of answer(source, question)) {
      text += piece;
      if (text.length < PIECE) continue;
      await write(text);
      text = "";
    }
    await write(`${text}\n`);
  } finally {
    source.close();
  }
}

/** Answers each line of standard input. @param {Decoder} decoder */
async function session(decoder) {
  for await (const line of createInterface({ input: process.stdin, crlfDelay: Infinity })) {
    if (line.trim() !== "") await reply(decoder, JSON.parse(line));
  }
}

/** @param {Decoder} decoder */
async function main(decoder) {
  const { values, positionals } = parseArgs({
    allowPositionals: true,
    options: {
      layers: { type: "string", default: "0" },
      stage: { type: "string", default: "all" },
      camera: { type: "string", default: "" },
      session: { type: "boolean", default: false },
    },
  });
  if (values.session) return session(decoder);
  const layers = Number(values.layers);
  if (positionals.length !== 1 || !Number.isInteger(layers)) {
    throw new Error("usage: FILE [--layers K] [--stage S] [--camera X,Y,Z], or --session");
  }
  const camera = values.camera === "" ? undefined : String(values.camera).split(",").map(Number);
  return reply(decoder, { file: positionals[0], layers, stage: String(values.stage), camera });
}

/** Answers what the command line asks. @param {Decoder} decoder */
export function serve(decoder) {
  main(decoder).catch((error) => {
    process.stderr.write(`${error.stack ?? error}\n`);
    process.exitCode = 1;
    process.stdin.destroy();
  });
}

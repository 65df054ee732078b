#!/usr/bin/env node
/**
 * The decoder protocol on the command line:
 *
 *     node cli.js FILE [--layers K] [--stage S] [--camera X,Y,Z]
 *     node cli.js --session
 */

import { closeSync, fstatSync, openSync, readSync } from "node:fs";
import { createInterface } from "node:readline";
import { parseArgs } from "node:util";

import { answer, CAPABILITIES } from "./answers.js";

/** @typedef {import("./source.js").Source} Source */

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

/** @param {{file: string, layers: number, stage: string, camera?: number[]}} question */
async function reply({ file, layers, stage, camera }) {
  if (stage === "capabilities") {
    await write(`${JSON.stringify({ capabilities: CAPABILITIES })}\n`);
    return;
  }
  const source = fileSource(file);
  try {
    let text = "";
    for (const piece of answer(source, { layers, stage, camera })) {
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

/** Answers each line of standard input. */
async function session() {
  for await (const line of createInterface({ input: process.stdin, crlfDelay: Infinity })) {
    if (line.trim() !== "") await reply(JSON.parse(line));
  }
}

async function main() {
  const { values, positionals } = parseArgs({
    allowPositionals: true,
    options: {
      layers: { type: "string", default: "0" },
      stage: { type: "string", default: "all" },
      camera: { type: "string", default: "" },
      session: { type: "boolean", default: false },
    },
  });
  if (values.session) return session();
  const layers = Number(values.layers);
  if (positionals.length !== 1 || !Number.isInteger(layers)) {
    throw new Error("usage: cli.js FILE [--layers K] [--stage S] [--camera X,Y,Z], or cli.js --session");
  }
  const camera = values.camera === "" ? undefined : String(values.camera).split(",").map(Number);
  return reply({ file: positionals[0], layers, stage: String(values.stage), camera });
}

main().catch((error) => {
  process.stderr.write(`${error.stack ?? error}\n`);
  process.exitCode = 1;
  process.stdin.destroy();
});

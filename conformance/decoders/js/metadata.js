/** METADATA (SPEC §7.10). */

import { BLOCK, MAX_METADATA_DEPTH } from "./constants.js";
import { blockBytes, checkBlock, findBlock } from "./container.js";
import { demand, Refused } from "./errors.js";

/**
 * @typedef {import("./container.js").Container} Container
 * @typedef {import("./constants.js").Limits} Limits
 */

const [QUOTE, BACKSLASH] = [0x22, 0x5c];
const [OPEN, CLOSE] = [
  [0x5b, 0x7b],
  [0x5d, 0x7d],
];
/** Of sound JSON: its strings and numbers. */
const TOKEN = /"[^"\\]*(?:\\.[^"\\]*)*"|-?\d[\d.eE+-]*/g;
/** Half a surrogate pair: \p{Surrogate} of whole characters. */
const HALF = /\p{Surrogate}/u;

/**
 * @param {Container} container
 * @param {Limits} limits
 * @returns {{text: string, value: object} | null} the JSON text as it is and what it says; null without the block
 */
export function readMetadata(container, limits) {
  const e = findBlock(container, 1, BLOCK.METADATA);
  if (e < 0) return null;
  const { length, offset } = container.entries;
  demand(length[e] <= limits.metadata_bytes, "limit-metadata", `${length[e]} bytes of METADATA`, offset[e]);
  checkBlock(container, e);
  return parseMetadata(blockBytes(container, e), offset[e]);
}

/**
 * @param {Uint8Array} bytes of the block
 * @param {number} [at] where it is in the file
 * @returns {{text: string, value: object}}
 */
export function parseMetadata(bytes, at = 0) {
  const deepest = nesting(bytes);
  demand(deepest <= MAX_METADATA_DEPTH, "limit-metadata", `METADATA is nested ${deepest} deep`, at);
  let text;
  let value;
  try {
    text = new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(bytes);
    value = JSON.parse(text);
  } catch {
    throw new Refused("bad-metadata", "METADATA is not JSON", at);
  }
  const object = typeof value === "object" && value !== null && !Array.isArray(value);
  demand(object, "bad-metadata", "METADATA is not an object", at);
  checkTokens(text, at);
  return { text, value };
}

/**
 * How many brackets are open at once at most, those in strings aside (R-7.10-3).
 * @param {Uint8Array} bytes any
 */
export function nesting(bytes) {
  let [depth, deepest, quoted] = [0, 0, false];
  for (let i = 0; i < bytes.length; i++) {
    const byte = bytes[i];
    if (quoted) {
      if (byte === BACKSLASH) i++;
      else quoted = byte !== QUOTE;
    } else if (byte === QUOTE) quoted = true;
    else if (OPEN.includes(byte)) deepest = Math.max(deepest, ++depth);
    else if (CLOSE.includes(byte)) depth--;
  }
  return deepest;
}

/**
 * Every number and string of sound JSON, those included that JSON.parse drops because their name comes again.
 * @param {string} text
 * @param {number} at
 */
function checkTokens(text, at) {
  for (const [token] of text.matchAll(TOKEN)) {
    const found = JSON.parse(token);
    if (typeof found === "number") demand(Number.isFinite(found), "bad-metadata", `${token.slice(0, 20)} is too large`, at);
    else demand(!HALF.test(found), "bad-metadata", "METADATA holds half a surrogate pair", at);
  }
}

/** METADATA (SPEC §7.10). */

import { BLOCK } from "./constants.js";
import { blockBytes, checkBlock, findBlock } from "./container.js";
import { demand, Refused } from "./errors.js";

/**
 * @typedef {import("./container.js").Container} Container
 * @typedef {import("./constants.js").Limits} Limits
 */

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
  let text;
  let value;
  try {
    text = new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(blockBytes(container, e));
    value = JSON.parse(text);
  } catch (error) {
    if (error instanceof Refused) throw error;
    throw new Refused("bad-metadata", "METADATA is not JSON", offset[e]);
  }
  const object = typeof value === "object" && value !== null && !Array.isArray(value);
  demand(object, "bad-metadata", "METADATA is not an object", offset[e]);
  demand(holdsFiniteNumbers(value), "bad-metadata", "METADATA holds a number too large for binary64", offset[e]);
  return { text, value };
}

/**
 * Without recursion, which nested data could exhaust.
 * @param {unknown} value of JSON.parse
 * @returns {boolean}
 */
function holdsFiniteNumbers(value) {
  const open = [value];
  while (open.length > 0) {
    const next = open.pop();
    if (typeof next === "number" && !Number.isFinite(next)) return false;
    if (typeof next === "object" && next !== null) for (const part of Object.values(next)) open.push(part);
  }
  return true;
}

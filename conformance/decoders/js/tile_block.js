/** TILE blocks: the sub-streams of one layer and one tile (SPEC §7.1). */

import { PROFILE, STREAM } from "./constants.js";
import { crc32 } from "./crc32.js";
import { demand, Refused } from "./errors.js";

/**
 * @typedef {{bytes: Uint8Array, offset: number | null}} SubStream
 * @typedef {Map<number, SubStream>} SubStreams by stream kind
 */

const RECORD = 9;
const MAX_RECORDS = 11;

/**
 * R-7.1-1 to R-7.1-5.
 * @param {Uint8Array} block whose CRC was checked
 * @param {number} offset in the file
 * @param {Set<number>} allowed stream kinds, R-7.1-4
 * @returns {SubStreams}
 */
export function readTileBlock(block, offset, allowed) {
  const bad = (/** @type {boolean} */ holds, /** @type {string} */ what) =>
    demand(holds, "bad-substream-table", what, offset);
  const count = block[0];
  const tableEnd = 1 + RECORD * count;
  bad(count <= MAX_RECORDS && tableEnd + 4 <= block.length, `a table of ${count} sub-streams`);
  const view = new DataView(block.buffer, block.byteOffset, block.byteLength);
  const sound = view.getUint32(tableEnd, true) === crc32(block.subarray(0, tableEnd));
  demand(sound, "crc-mismatch", "the CRC of the table of sub-streams", offset + tableEnd);
  const records = Array.from({ length: count }, (_, i) => {
    const at = 1 + RECORD * i;
    return { stream: block[at], length: view.getUint32(at + 1, true), crc: view.getUint32(at + 5, true) };
  });
  let end = tableEnd + 4;
  records.forEach(({ stream, length }, i) => {
    const before = i === 0 ? 0 : records[i - 1].stream;
    bad(stream > before && stream <= STREAM.OFFSETS, `stream kind ${stream}`);
    bad(length > 0 && length % 4 === 0, `a sub-stream of ${length} bytes`);
    end += length;
  });
  bad(end === block.length, "sub-streams do not end with the block");
  for (const { stream } of records) bad(allowed.has(stream), `stream kind ${stream} has no place here`);
  /** @type {SubStreams} */
  const streams = new Map();
  let at = tableEnd + 4;
  for (const { stream, length, crc } of records) {
    const bytes = block.subarray(at, at + length);
    if (crc32(bytes) !== crc) throw new Refused("crc-mismatch", `the sub-stream ${stream}`, offset + at);
    streams.set(stream, { bytes, offset: offset + at });
    at += length;
  }
  return streams;
}

/**
 * R-7.1-4.
 * @param {number} profile
 * @param {number[]} channels stream kinds of the channel table
 * @param {boolean} appears anchors appear in the block
 * @returns {Set<number>}
 */
export function allowedStreams(profile, channels, appears) {
  const allowed = new Set([...channels, STREAM.INDICES]);
  if (appears) allowed.add(STREAM.POSITIONS).add(STREAM.CLASSES);
  if (profile === PROFILE.ANCHOR) allowed.add(STREAM.MASKS);
  return allowed;
}

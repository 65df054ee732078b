/** Tile pages and row pages (SPEC §5.5): where the tiles of a page lie, and what blocks they have in a layer. */

import { Reader } from "./bytes.js";
import { crc32 } from "./crc32.js";
import { demand, Refused } from "./errors.js";
import { tilesInPage } from "./root.js";

/**
 * @typedef {import("./constants.js").Limits} Limits
 * @typedef {import("./header.js").Header} Header
 * @typedef {import("./root.js").Root} Root
 * @typedef {{depth: Uint8Array, shift: Uint8Array, prefix: BigUint64Array}} Tiles one number a tile
 * @typedef {{length: Float64Array, count: Uint32Array, crc32: Uint32Array}} Rows one number a tile of a page, 0 in all
 *   of one that has no block
 */

const MAX_DEPTH = 21;
const MAX_SHIFT = 31;
const MAX_LOCAL_BITS = 21;

/**
 * Rules of §5.5 for a tile page, in their order.
 * @param {Uint8Array} bytes of the page
 * @param {Header} header
 * @param {Root} root
 * @param {number} page
 * @returns {Tiles}
 */
export function readTilePage(bytes, header, root, page) {
  const offset = root.tilePages.offset[page];
  demand(crc32(bytes) === root.tilePages.crc32[page], "page-crc-mismatch", `CRC of tile page ${page}`, offset);
  const reader = new Reader(bytes, offset);
  const n = tilesInPage(header, page);
  const depth = reader.take(n).slice();
  const shift = reader.take(n).slice();
  const gaps = new BigUint64Array(n);
  for (let i = 0; i < n; i++) gaps[i] = reader.bigVarint(63);
  reader.end();
  checkColumns(depth, shift, header.lattice_bits, { page, offset });
  const last = page === root.pages - 1 ? 1n << BigInt(3 * MAX_DEPTH) : root.base[page + 1];
  return { depth, shift, prefix: prefixes(depth, gaps, root.base[page], last, offset) };
}

/**
 * R-5.5-3 to R-5.5-5, each over all tiles before the next.
 * @param {Uint8Array} depth
 * @param {Uint8Array} shift
 * @param {number} latticeBits
 * @param {{page: number, offset: number}} place
 */
function checkColumns(depth, shift, latticeBits, { page, offset }) {
  const all = (/** @type {(i: number) => boolean} */ holds, /** @type {string} */ id) => {
    for (let i = 0; i < depth.length; i++) if (!holds(i)) throw new Refused(id, `tile ${i} of page ${page}`, offset);
  };
  all((i) => depth[i] <= MAX_DEPTH, "tile-depth");
  all((i) => shift[i] <= MAX_SHIFT, "tile-shift");
  all((i) => {
    const bits = latticeBits - depth[i] - shift[i];
    return bits >= 0 && bits <= MAX_LOCAL_BITS;
  }, "tile-local-bits");
}

/**
 * R-5.5-6, R-5.5-7.
 * @param {Uint8Array} depth
 * @param {BigUint64Array} gaps
 * @param {bigint} base Morton code where the first tile begins
 * @param {bigint} end where the last tile ends at the latest
 * @param {number} offset of the page
 * @returns {BigUint64Array}
 */
function prefixes(depth, gaps, base, end, offset) {
  const prefix = new BigUint64Array(depth.length);
  let past = base;
  let first = base;
  for (let i = 0; i < depth.length; i++) {
    const free = BigInt(3 * (MAX_DEPTH - depth[i]));
    const code = ((past + (1n << free) - 1n) >> free) + gaps[i];
    demand(code >> BigInt(3 * depth[i]) === 0n, "tile-prefix", `a tile of depth ${depth[i]} at ${code}`, offset);
    if (i === 0) first = code << free;
    past = (code + 1n) << free;
    prefix[i] = code;
  }
  demand(first === base && past <= end, "tile-order", `a page from ${base} has tiles from ${first} to ${past}`, offset);
  return prefix;
}

/**
 * Rules of §5.5 for a row page, in their order.
 * @param {Uint8Array} bytes of the page
 * @param {Header} header
 * @param {Root} root
 * @param {{layer: number, page: number}} place
 * @param {Limits} limits
 * @returns {Rows}
 */
export function readRowPage(bytes, header, root, { layer, page }, limits) {
  const told = root.rowPages[layer - 1];
  const offset = told.offset[page];
  demand(crc32(bytes) === told.crc32[page], "page-crc-mismatch", `CRC of row page ${page} of layer ${layer}`, offset);
  const reader = new Reader(bytes, offset);
  const n = tilesInPage(header, page);
  const rows = { length: new Float64Array(n), count: new Uint32Array(n), crc32: new Uint32Array(n) };
  for (let i = 0; i < n; i++) rows.length[i] = reader.varint(53);
  for (let i = 0; i < n; i++) if (rows.length[i] > 0) rows.count[i] = reader.varint(32);
  for (let i = 0; i < n; i++) if (rows.length[i] > 0) rows.crc32[i] = reader.u32();
  reader.end();
  const where = `row page ${page} of layer ${layer}`;
  demand(rows.length.every((bytes) => bytes <= limits.block_bytes), "limit-block-bytes", where, offset);
  demand(rows.count.every((anchors) => anchors <= limits.tile_anchors), "limit-tile-anchors", where, offset);
  const length = rows.length.reduce((a, b) => a + b, 0);
  const anchors = rows.count.reduce((a, b) => a + b, 0);
  demand(length === told.blockBytes[page] && anchors === told.anchors[page], "page-sums", where, offset);
  return rows;
}

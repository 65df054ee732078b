/** Tile pages and row pages (SPEC §5.5): where the tiles of a page lie, and what blocks they have in a layer. */

import { crc32 } from "./crc32.js";
import { demand } from "./errors.js";
import type { Header } from "./header.js";
import { Reader } from "./reader.js";
import { LIMITS, MAX_DEPTH } from "./registry.js";
import { PAST_ALL, type Root, tilesInPage } from "./root.js";

/** One number a tile. */
export interface Cubes {
  depth: Uint8Array;
  shift: Uint8Array;
  prefix: BigUint64Array;
}

/** One number a tile of a page, 0 in all of one that has no block. */
export interface Rows {
  length: Float64Array;
  count: Uint32Array;
  crc32: Uint32Array;
}

const MAX_SHIFT = 31;
const MAX_LOCAL_BITS = 21;

/** Rules of §5.5 for a tile page, in their order. */
export function readTilePage(bytes: Uint8Array, header: Header, root: Root, page: number): Cubes {
  const offset = root.tilePages.offset[page];
  demand(crc32(bytes) === root.tilePages.crc32[page], "page-crc-mismatch", `CRC of tile page ${page}`, offset);
  const reader = new Reader(bytes, offset);
  const n = tilesInPage(header, page);
  const depth = reader.take(n).slice();
  const shift = reader.take(n).slice();
  const gaps = new BigUint64Array(n);
  for (let i = 0; i < n; i++) gaps[i] = reader.bigVarint(63);
  reader.end();
  checkColumns(depth, shift, header.lattice_bits, page, offset);
  const end = page === root.pages - 1 ? PAST_ALL : root.base[page + 1];
  return { depth, shift, prefix: prefixes(depth, gaps, root.base[page], end, offset) };
}

/** R-5.5-3 to R-5.5-5, each over all tiles before the next. */
function checkColumns(depth: Uint8Array, shift: Uint8Array, latticeBits: number, page: number, offset: number): void {
  const all = (holds: (i: number) => boolean, id: string) => {
    for (let i = 0; i < depth.length; i++) demand(holds(i), id, `tile ${i} of page ${page}`, offset);
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
 * @param base Morton code where the first tile begins
 * @param end where the last tile ends at the latest
 * @param offset of the page
 */
function prefixes(depth: Uint8Array, gaps: BigUint64Array, base: bigint, end: bigint, offset: number): BigUint64Array {
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

/** Rules of §5.5 for a row page, in their order. */
export function readRowPage(bytes: Uint8Array, header: Header, root: Root, layer: number, page: number): Rows {
  const pages = root.rowPages[layer - 1];
  const offset = pages.offset[page];
  const where = `row page ${page} of layer ${layer}`;
  demand(crc32(bytes) === pages.crc32[page], "page-crc-mismatch", `CRC of ${where}`, offset);
  const reader = new Reader(bytes, offset);
  const n = tilesInPage(header, page);
  const rows = { length: new Float64Array(n), count: new Uint32Array(n), crc32: new Uint32Array(n) };
  for (let i = 0; i < n; i++) rows.length[i] = reader.varint(53);
  for (let i = 0; i < n; i++) if (rows.length[i] > 0) rows.count[i] = reader.varint(32);
  for (let i = 0; i < n; i++) if (rows.length[i] > 0) rows.crc32[i] = reader.u32();
  reader.end();
  demand(rows.length.every((size) => size <= LIMITS.block_bytes), "limit-block-bytes", where, offset);
  demand(rows.count.every((anchors) => anchors <= LIMITS.tile_anchors), "limit-tile-anchors", where, offset);
  const length = rows.length.reduce((a, b) => a + b, 0);
  const anchors = rows.count.reduce((a, b) => a + b, 0);
  demand(length === pages.blockBytes[page] && anchors === pages.anchors[page], "page-sums", where, offset);
  return rows;
}

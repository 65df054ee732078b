/** The directory and its blocks (SPEC §5.4 to §5.6): everything about a file but the content of its blocks. */

import { BLOCK, NO_TILE } from "./constants.js";
import { crc32 } from "./crc32.js";
import { demand } from "./errors.js";
import { readHeader } from "./header.js";
import { readRowPage, readTilePage } from "./pages.js";
import { readRoot } from "./root.js";

/**
 * @typedef {import("./constants.js").Limits} Limits
 * @typedef {import("./source.js").Source} Source
 * @typedef {import("./header.js").Header} Header
 * @typedef {import("./header.js").Summary} Summary
 * @typedef {import("./pages.js").Tiles} Tiles
 * @typedef {import("./pages.js").Rows} Rows
 * @typedef {import("./root.js").Root} Root
 * @typedef {{kind: Uint8Array, flags: Uint8Array, layer: Uint8Array, tile: Uint32Array, offset: Float64Array,
 *   length: Float64Array, count: Uint32Array, crc32: Uint32Array}} Entries one number an entry
 * @typedef {{source: Source, header: Header, layers: Summary[]}} Start
 * @typedef {Start & {root: Root}} Front what is known before any page is read
 * @typedef {Start & {tiles: Tiles, entries: Entries}} Container
 */

const CHUNK = 1 << 20;

/**
 * Rules of §5.1 to §5.4, in their order. Pages are not read: the source needs no more than header and ROOT.
 * @param {Source} source
 * @param {Limits} limits
 * @param {boolean} allowTruncated
 * @returns {Front}
 */
export function readFront(source, limits, allowTruncated) {
  const { header, layers } = readHeader(source, limits, allowTruncated);
  return { source, header, layers, root: readRoot(source, header, layers, limits) };
}

/**
 * Rules of §5.1 to §5.5, in their order: all pages are read.
 * @param {Source} source
 * @param {Limits} limits
 * @param {boolean} allowTruncated
 * @returns {Container}
 */
export function readContainer(source, limits, allowTruncated) {
  const front = readFront(source, limits, allowTruncated);
  const { header, layers } = front;
  return { source, header, layers, tiles: readTiles(front), entries: joinEntries(front, readRows(front, limits)) };
}

/** @param {Front} front @returns {Tiles} */
function readTiles({ source, header, root }) {
  const count = header.tile_count;
  const tiles = { depth: new Uint8Array(count), shift: new Uint8Array(count), prefix: new BigUint64Array(count) };
  const { offset, length } = root.tilePages;
  for (let p = 0; p < root.pages; p++) {
    const page = readTilePage(source.read(offset[p], length[p]), header, root, p);
    const start = p * 2 ** header.page_bits;
    tiles.depth.set(page.depth, start);
    tiles.shift.set(page.shift, start);
    tiles.prefix.set(page.prefix, start);
  }
  return tiles;
}

/** @param {Front} front @param {Limits} limits @returns {(Rows | null)[][]} by layer - 1, then page; null: not there */
function readRows({ source, header, root }, limits) {
  return root.rowPages.map(({ offset, length }, i) =>
    Array.from(length, (bytes, page) => {
      if (bytes === 0) return null;
      return readRowPage(source.read(offset[page], bytes), header, root, { layer: i + 1, page }, limits);
    }),
  );
}

/**
 * Entries of all blocks in the order in which they lie, which says where they are.
 * @param {Front} front
 * @param {(Rows | null)[][]} rows
 * @returns {Entries}
 */
function joinEntries({ header, layers, root }, rows) {
  const ofTiles = rows.flat().reduce((sum, page) => sum + (page?.length.filter((bytes) => bytes > 0).length ?? 0), 0);
  const entries = emptyEntries(root.blocks.length + ofTiles);
  let e = 0;
  const add = (/** @type {import("./root.js").Row} */ row) => putEntry(entries, e++, { ...row, tile: NO_TILE });
  layers.forEach(({ end_offset, byte_count }, i) => {
    const blocks = root.blocks.filter(({ layer }) => layer === i + 1);
    const models = blocks.filter(({ kind }) => kind < BLOCK.TILE);
    models.forEach(add);
    let offset = models.reduce((sum, { length }) => sum + length, end_offset - byte_count);
    rows[i].forEach((page, p) => {
      if (page === null) return;
      const first = p * 2 ** header.page_bits;
      for (let t = 0; t < page.length.length; t++) {
        if (page.length[t] === 0) continue;
        entries.kind[e] = BLOCK.TILE;
        entries.flags[e] = 1;
        entries.layer[e] = i + 1;
        entries.tile[e] = first + t;
        entries.offset[e] = offset;
        entries.length[e] = page.length[t];
        entries.count[e] = page.count[t];
        entries.crc32[e++] = page.crc32[t];
        offset += page.length[t];
      }
    });
    blocks.filter(({ kind }) => kind > BLOCK.TILE).forEach(add);
  });
  return entries;
}

/** @param {number} count @returns {Entries} */
export function emptyEntries(count) {
  return {
    kind: new Uint8Array(count),
    flags: new Uint8Array(count),
    layer: new Uint8Array(count),
    tile: new Uint32Array(count),
    offset: new Float64Array(count),
    length: new Float64Array(count),
    count: new Uint32Array(count),
    crc32: new Uint32Array(count),
  };
}

/**
 * @param {Entries} entries
 * @param {number} e
 * @param {Record<keyof Entries, number>} row
 */
export function putEntry(entries, e, row) {
  for (const name of /** @type {(keyof Entries)[]} */ (Object.keys(entries))) entries[name][e] = row[name];
}

/**
 * The entry of a block, or -1.
 * @param {Container} container
 * @param {number} layer from 1
 * @param {number} kind
 * @param {number} [tile]
 * @returns {number}
 */
export function findBlock({ entries }, layer, kind, tile = NO_TILE) {
  let low = 0;
  let high = entries.kind.length;
  while (low < high) {
    const e = (low + high) >>> 1;
    const before =
      entries.layer[e] !== layer
        ? entries.layer[e] < layer
        : entries.kind[e] !== kind
          ? entries.kind[e] < kind
          : entries.tile[e] < tile;
    if (before) low = e + 1;
    else high = e;
  }
  const found = low < entries.kind.length && entries.layer[low] === layer;
  return found && entries.kind[low] === kind && entries.tile[low] === tile ? low : -1;
}

/**
 * The bytes of a block whose CRC was checked.
 * @param {Container} container
 * @param {number} e
 * @returns {Uint8Array}
 */
export function blockBytes({ source, entries }, e) {
  requireArrived(source, entries, e);
  return source.read(entries.offset[e], entries.length[e]);
}

/**
 * @param {Source} source
 * @param {Entries} entries
 * @param {number} e
 */
function requireArrived(source, entries, e) {
  const arrived = entries.offset[e] + entries.length[e] <= source.length;
  demand(arrived, "truncated-block", `the block of entry ${e} is cut`, source.length);
}

/**
 * R-5.6-1, without holding the block in memory.
 * @param {Container} container
 * @param {number} e
 */
export function checkBlock({ source, entries }, e) {
  requireArrived(source, entries, e);
  const end = entries.offset[e] + entries.length[e];
  let crc = 0;
  for (let at = entries.offset[e]; at < end; at += CHUNK) crc = crc32(source.read(at, Math.min(CHUNK, end - at)), crc);
  demand(crc === entries.crc32[e], "crc-mismatch", `the block of entry ${e}`, entries.offset[e]);
}

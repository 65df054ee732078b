/** ROOT (SPEC §5.4): the blocks of no tile, and what there is of pages, by which each can be read and checked alone. */

import { Reader } from "./bytes.js";
import { BLOCK } from "./constants.js";
import { crc32 } from "./crc32.js";
import { demand, Refused } from "./errors.js";
import { directoryEnd } from "./header.js";

/**
 * @typedef {import("./constants.js").Limits} Limits
 * @typedef {import("./source.js").Source} Source
 * @typedef {import("./header.js").Header} Header
 * @typedef {import("./header.js").Summary} Summary
 * @typedef {{layer: number, kind: number, flags: number, offset: number, length: number, count: number, crc32: number,
 *   at: number}} Row a block of no tile; `at` is where ROOT says so
 * @typedef {{offset: Float64Array, length: Float64Array, crc32: Uint32Array}} Pages one number a page
 * @typedef {Pages & {blockBytes: Float64Array, anchors: Float64Array}} RowPages of one layer
 * @typedef {object} Root
 * @property {number} pages
 * @property {Row[]} blocks in the order of the file
 * @property {BigUint64Array} base (pages) Morton code at depth 21 where the first tile of a page begins
 * @property {Float64Array} at (pages) where in the file ROOT tells of a page
 * @property {Pages} tilePages
 * @property {RowPages[]} rowPages by layer - 1; pages of 0 bytes are not there
 */

const LAST_KNOWN_MODEL = BLOCK.PREDICTORS;
const PAST_BASES = 1n << 63n;

/**
 * Rules of §5.4, in their order.
 * @param {Source} source
 * @param {Header} header
 * @param {Summary[]} layers
 * @param {Limits} limits
 * @returns {Root}
 */
export function readRoot(source, header, layers, limits) {
  demand(source.length >= directoryEnd(layers), "truncated-directory", "the directory is cut", source.length);
  const bytes = source.read(header.header_length, header.root_length);
  demand(crc32(bytes) === header.root_crc32, "directory-crc-mismatch", "CRC of ROOT", header.header_length);
  const { root, gaps } = parseRoot(new Reader(bytes, header.header_length), header);
  checkBlocks(root.blocks, header, limits);
  placeBases(root, gaps);
  checkPages(root, header);
  layers.forEach((_, i) => checkSums(root, layers, i));
  placePages(root, header, layers);
  placeBlocks(root, layers);
  root.blocks.forEach(({ flags, kind, at }) => {
    demand((flags & 1) === 0 || known(kind), "unknown-critical-block", `block of kind ${kind}`, at);
  });
  return root;
}

/**
 * Tiles of a page.
 * @param {Header} header
 * @param {number} page
 * @returns {number}
 */
export function tilesInPage(header, page) {
  const size = 2 ** header.page_bits;
  return Math.min(size, header.tile_count - page * size);
}

/** @param {number} kind */
function known(kind) {
  return kind <= LAST_KNOWN_MODEL || kind === BLOCK.METADATA;
}

/**
 * @param {Reader} reader
 * @param {Header} header
 * @returns {{root: Root, gaps: BigUint64Array}}
 */
function parseRoot(reader, header) {
  const pages = Math.ceil(header.tile_count / 2 ** header.page_bits);
  /** @type {Row[]} */
  const blocks = [];
  for (let layer = 1; layer <= header.layer_count; layer++) {
    for (let left = reader.varint(8); left > 0; left--) blocks.push(parseRow(reader, layer));
  }
  // No room for more pages than there can be: ROOT is short of the others.
  const room = Math.min(pages, reader.left);
  const root = {
    pages,
    blocks,
    base: new BigUint64Array(room),
    at: new Float64Array(room),
    tilePages: emptyPages(room),
    rowPages: Array.from({ length: header.layer_count }, () => emptyRows(room)),
  };
  const gaps = new BigUint64Array(room);
  for (let p = 0; p < pages; p++) {
    root.at[p] = reader.offset ?? 0;
    gaps[p] = reader.bigVarint(63);
    root.tilePages.length[p] = reader.varint(32);
    root.tilePages.crc32[p] = reader.u32();
    for (const rows of root.rowPages) parseRowPage(reader, rows, p);
  }
  reader.end();
  return { root, gaps };
}

/** @param {Reader} reader @param {number} layer @returns {Row} */
function parseRow(reader, layer) {
  const at = reader.offset ?? 0;
  const [kind, flags] = [reader.u8(), reader.u8()];
  const [length, count] = [reader.varint(53), reader.varint(32)];
  return { layer, kind, flags, offset: 0, length, count, crc32: reader.u32(), at };
}

/** @param {Reader} reader @param {RowPages} rows @param {number} p */
function parseRowPage(reader, rows, p) {
  rows.length[p] = reader.varint(32);
  if (rows.length[p] === 0) return;
  rows.crc32[p] = reader.u32();
  rows.blockBytes[p] = reader.varint(53);
  rows.anchors[p] = reader.varint(53);
}

/** @param {number} pages @returns {Pages} */
function emptyPages(pages) {
  return { offset: new Float64Array(pages), length: new Float64Array(pages), crc32: new Uint32Array(pages) };
}

/** @param {number} pages @returns {RowPages} */
function emptyRows(pages) {
  return { ...emptyPages(pages), blockBytes: new Float64Array(pages), anchors: new Float64Array(pages) };
}

/**
 * R-5.4-4 to R-5.4-10, each over all blocks before the next.
 * @param {Row[]} blocks
 * @param {Header} header
 * @param {Limits} limits
 */
function checkBlocks(blocks, header, limits) {
  const all = (/** @type {(row: Row, i: number) => boolean} */ holds, /** @type {string} */ id) => {
    blocks.forEach((row, i) => demand(holds(row, i), id, `block of kind ${row.kind} of layer ${row.layer}`, row.at));
  };
  all(({ kind }) => kind !== 0 && kind !== BLOCK.TILE, "entry-kind");
  all(({ kind, flags }) => flagsFit(kind, flags), "entry-flags");
  all(({ kind, layer }) => kind !== BLOCK.METADATA || layer === 1, "entry-layer");
  all(({ kind, layer }, i) => i === 0 || layer !== blocks[i - 1].layer || kind > blocks[i - 1].kind, "entry-order");
  all(({ length }) => length >= 1 && length <= header.file_length, "entry-length");
  all(({ length }) => length <= limits.block_bytes, "limit-block-bytes");
  all(({ kind, count }) => kind !== BLOCK.METADATA || count === 0, "entry-count");
}

/**
 * @param {number} kind
 * @param {number} flags
 */
function flagsFit(kind, flags) {
  if (kind < BLOCK.TILE) return flags === 1;
  return kind === BLOCK.METADATA ? flags === 2 : flags <= 2;
}

/**
 * R-5.4-11.
 * @param {Root} root
 * @param {BigUint64Array} gaps
 */
function placeBases({ base, at }, gaps) {
  let code = 0n;
  gaps.forEach((gap, p) => {
    code += gap;
    demand((p === 0 || gap > 0n) && code < PAST_BASES, "tile-order", `page ${p} begins at ${code}`, at[p]);
    base[p] = code;
  });
}

/**
 * R-5.4-12, R-5.4-13, each over all pages.
 * @param {Root} root
 * @param {Header} header
 */
function checkPages({ pages, at, tilePages, rowPages }, header) {
  for (let p = 0; p < pages; p++) {
    const n = tilesInPage(header, p);
    const fits = (/** @type {number} */ length) => length === 0 || (length >= n + 5 && length <= 17 * n);
    const tiles = tilePages.length[p];
    const holds = tiles >= 3 * n && tiles <= 11 * n && rowPages.every(({ length }) => fits(length[p]));
    demand(holds, "page-length", `pages of ${n} tiles`, at[p]);
  }
  for (let p = 0; p < pages; p++) {
    const holds = rowPages.every(({ length, blockBytes }) => length[p] === 0 || blockBytes[p] > 0);
    demand(holds, "page-sums", `page ${p} has rows of no bytes`, at[p]);
  }
}

/**
 * R-5.4-14. Doubles add up exactly below 2^53, and stay above it once they are (R-5.4-17).
 * @param {Root} root
 * @param {Summary[]} layers
 * @param {number} i layer - 1
 */
function checkSums({ blocks, rowPages }, layers, i) {
  const models = blocks.reduce((sum, { layer, length }) => (layer === i + 1 ? sum + length : sum), 0);
  const bytes = rowPages[i].blockBytes.reduce((a, b) => a + b, models);
  const fits = bytes === layers[i].byte_count && models === layers[i].stream_bytes[0];
  demand(fits, "layer-directory-bytes", `the blocks of layer ${i + 1}`);
  const before = i === 0 ? 0 : layers[i - 1].anchor_count;
  const anchors = rowPages[i].anchors.reduce((a, b) => a + b, 0);
  demand(anchors === layers[i].anchor_count - before, "layer-directory-anchors", `anchors of layer ${i + 1}`);
}

/**
 * Where pages are, which R-5.4-15 follows from.
 * @param {Root} root
 * @param {Header} header
 * @param {Summary[]} layers
 */
function placePages({ tilePages, rowPages }, header, layers) {
  let end = header.header_length + header.root_length;
  for (const { offset, length } of [tilePages, ...rowPages]) {
    length.forEach((bytes, p) => {
      offset[p] = end;
      end += bytes;
    });
  }
  const d = directoryEnd(layers);
  if (end !== d) throw new Refused("directory-length", `pages end at ${end}, blocks begin at ${d}`, header.header_length);
}

/**
 * Where blocks are: those of greater kinds than TILE lie behind the tiles of their layer.
 * @param {Root} root
 * @param {Summary[]} layers
 */
function placeBlocks({ blocks, rowPages }, layers) {
  layers.forEach(({ end_offset, byte_count }, i) => {
    let offset = end_offset - byte_count;
    const place = (/** @type {Row} */ row) => {
      row.offset = offset;
      offset += row.length;
    };
    const own = blocks.filter(({ layer }) => layer === i + 1);
    own.filter(({ kind }) => kind < BLOCK.TILE).forEach(place);
    offset = rowPages[i].blockBytes.reduce((a, b) => a + b, offset);
    own.filter(({ kind }) => kind > BLOCK.TILE).forEach(place);
  });
}

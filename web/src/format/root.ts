/** ROOT (SPEC §5.4): the blocks of no tile, and what there is of pages, by which each can be read and checked alone. */

import { crc32 } from "./crc32.js";
import { demand } from "./errors.js";
import { directoryEnd, type Header, type Summary } from "./header.js";
import { Reader } from "./reader.js";
import { BLOCK, LIMITS, MAX_DEPTH } from "./registry.js";

/** A block of no tile; `at` is where ROOT says so. */
export interface RootBlock {
  layer: number;
  kind: number;
  flags: number;
  offset: number;
  length: number;
  count: number;
  crc32: number;
  at: number;
}

/** One number a page; pages of 0 bytes are not there. */
export interface Pages {
  offset: Float64Array;
  length: Float64Array;
  crc32: Uint32Array;
}

/** Row pages of one layer. */
export interface RowPages extends Pages {
  /** Bytes of the TILE blocks of a page. */
  blockBytes: Float64Array;
  /** Anchors that appear in the tiles of a page. */
  anchors: Float64Array;
}

export interface Root {
  pages: number;
  /** In the order of the file. */
  blocks: RootBlock[];
  /** (pages) Morton code at depth 21 where the first tile of a page begins. */
  base: BigUint64Array;
  /** (pages) where in the file ROOT describes a page. */
  at: Float64Array;
  tilePages: Pages;
  /** By layer - 1. */
  rowPages: RowPages[];
}

/** One past the last Morton code at depth 21. */
export const PAST_ALL = 1n << BigInt(3 * MAX_DEPTH);

/**
 * Rules of §5.4, in their order.
 * @param file its first bytes, header and ROOT at least unless it is shorter
 * @param size of the file, bytes
 */
export function readRoot(file: Uint8Array, size: number, header: Header, layers: Summary[]): Root {
  demand(size >= directoryEnd(layers), "truncated-directory", "the directory is cut", size);
  const start = header.header_length;
  const bytes = file.subarray(start, start + header.root_length);
  demand(crc32(bytes) === header.root_crc32, "directory-crc-mismatch", "CRC of ROOT", start);
  const { root, gaps } = parseRoot(new Reader(bytes, start), header);
  checkBlocks(root.blocks, header);
  placeBases(root, gaps);
  checkPages(root, header);
  layers.forEach((_, i) => checkSums(root, layers, i));
  placePages(root, header, layers);
  placeBlocks(root, layers);
  for (const { flags, kind, at } of root.blocks) {
    const known = kind <= BLOCK.PREDICTORS || kind === BLOCK.METADATA;
    demand((flags & 1) === 0 || known, "unknown-critical-block", `block of kind ${kind}`, at);
  }
  return root;
}

/** Tiles of a page. */
export function tilesInPage(header: Header, page: number): number {
  const size = 2 ** header.page_bits;
  return Math.min(size, header.tile_count - page * size);
}

function parseRoot(reader: Reader, header: Header): { root: Root; gaps: BigUint64Array } {
  const pages = Math.ceil(header.tile_count / 2 ** header.page_bits);
  const blocks: RootBlock[] = [];
  for (let layer = 1; layer <= header.layer_count; layer++) {
    for (let left = reader.varint(8); left > 0; left--) blocks.push(parseBlock(reader, layer));
  }
  // No room for more pages than there can be: ROOT is short of the others.
  const room = Math.min(pages, reader.left);
  const root: Root = {
    pages,
    blocks,
    base: new BigUint64Array(room),
    at: new Float64Array(room),
    tilePages: emptyPages(room),
    rowPages: Array.from({ length: header.layer_count }, () => {
      return { ...emptyPages(room), blockBytes: new Float64Array(room), anchors: new Float64Array(room) };
    }),
  };
  const gaps = new BigUint64Array(room);
  for (let p = 0; p < pages; p++) {
    root.at[p] = reader.offset;
    gaps[p] = reader.bigVarint(63);
    root.tilePages.length[p] = reader.varint(32);
    root.tilePages.crc32[p] = reader.u32();
    for (const rows of root.rowPages) parseRowPage(reader, rows, p);
  }
  reader.end();
  return { root, gaps };
}

function parseBlock(reader: Reader, layer: number): RootBlock {
  const at = reader.offset;
  const [kind, flags] = [reader.u8(), reader.u8()];
  const [length, count] = [reader.varint(53), reader.varint(32)];
  return { layer, kind, flags, offset: 0, length, count, crc32: reader.u32(), at };
}

function parseRowPage(reader: Reader, rows: RowPages, p: number): void {
  rows.length[p] = reader.varint(32);
  if (rows.length[p] === 0) return;
  rows.crc32[p] = reader.u32();
  rows.blockBytes[p] = reader.varint(53);
  rows.anchors[p] = reader.varint(53);
}

function emptyPages(pages: number): Pages {
  return { offset: new Float64Array(pages), length: new Float64Array(pages), crc32: new Uint32Array(pages) };
}

/** R-5.4-4 to R-5.4-10, each over all blocks before the next. */
function checkBlocks(blocks: RootBlock[], header: Header): void {
  const all = (holds: (block: RootBlock, i: number) => boolean, id: string) => {
    blocks.forEach((row, i) => demand(holds(row, i), id, `block of kind ${row.kind} of layer ${row.layer}`, row.at));
  };
  all(({ kind }) => kind !== 0 && kind !== BLOCK.TILE, "entry-kind");
  all(({ kind, flags }) => flagsFit(kind, flags), "entry-flags");
  all(({ kind, layer }) => kind !== BLOCK.METADATA || layer === 1, "entry-layer");
  all(({ kind, layer }, i) => i === 0 || layer !== blocks[i - 1].layer || kind > blocks[i - 1].kind, "entry-order");
  all(({ length }) => length >= 1 && length <= header.file_length, "entry-length");
  all(({ length }) => length <= LIMITS.block_bytes, "limit-block-bytes");
  all(({ kind, count }) => kind !== BLOCK.METADATA || count === 0, "entry-count");
}

function flagsFit(kind: number, flags: number): boolean {
  if (kind < BLOCK.THUMBNAIL) return flags === 1;
  return kind === BLOCK.THUMBNAIL || kind === BLOCK.METADATA ? flags === 2 : flags <= 2;
}

/** R-5.4-11. */
function placeBases({ base, at }: Root, gaps: BigUint64Array): void {
  let code = 0n;
  gaps.forEach((gap, p) => {
    code += gap;
    demand((p === 0 || gap > 0n) && code < PAST_ALL, "tile-order", `page ${p} begins at ${code}`, at[p]);
    base[p] = code;
  });
}

/** R-5.4-12, R-5.4-13, each over all pages. */
function checkPages({ pages, at, tilePages, rowPages }: Root, header: Header): void {
  for (let p = 0; p < pages; p++) {
    const n = tilesInPage(header, p);
    const fits = (length: number) => length === 0 || (length >= n + 5 && length <= 17 * n);
    const tiles = tilePages.length[p];
    const holds = tiles >= 3 * n && tiles <= 11 * n && rowPages.every(({ length }) => fits(length[p]));
    demand(holds, "page-length", `pages of ${n} tiles`, at[p]);
  }
  for (let p = 0; p < pages; p++) {
    const holds = rowPages.every(({ length, blockBytes }) => length[p] === 0 || blockBytes[p] > 0);
    demand(holds, "page-sums", `page ${p} has rows of no bytes`, at[p]);
  }
}

/** R-5.4-14. Doubles add up exactly below 2^53, and stay above it once they are (R-5.4-17). @param i layer - 1 */
function checkSums({ blocks, rowPages }: Root, layers: Summary[], i: number): void {
  const models = blocks.reduce((sum, { layer, length }) => (layer === i + 1 ? sum + length : sum), 0);
  const bytes = rowPages[i].blockBytes.reduce((a, b) => a + b, models);
  const fits = bytes === layers[i].byte_count && models === layers[i].stream_bytes[0];
  demand(fits, "layer-directory-bytes", `the blocks of layer ${i + 1}`);
  const before = i === 0 ? 0 : layers[i - 1].anchor_count;
  const anchors = rowPages[i].anchors.reduce((a, b) => a + b, 0);
  demand(anchors === layers[i].anchor_count - before, "layer-directory-anchors", `anchors of layer ${i + 1}`);
}

/** Where pages are, which R-5.4-15 follows from. */
function placePages({ tilePages, rowPages }: Root, header: Header, layers: Summary[]): void {
  let end = header.header_length + header.root_length;
  for (const { offset, length } of [tilePages, ...rowPages]) {
    length.forEach((bytes, p) => {
      offset[p] = end;
      end += bytes;
    });
  }
  const d = directoryEnd(layers);
  demand(end === d, "directory-length", `pages end at ${end}, blocks begin at ${d}`, header.header_length);
}

/** Where blocks are: those of greater kinds than TILE lie behind the tiles of their layer. */
function placeBlocks({ blocks, rowPages }: Root, layers: Summary[]): void {
  layers.forEach(({ end_offset, byte_count }, i) => {
    let offset = end_offset - byte_count;
    const place = (row: RootBlock) => {
      row.offset = offset;
      offset += row.length;
    };
    const own = blocks.filter(({ layer }) => layer === i + 1);
    own.filter(({ kind }) => kind < BLOCK.TILE).forEach(place);
    offset = rowPages[i].blockBytes.reduce((a, b) => a + b, offset);
    own.filter(({ kind }) => kind > BLOCK.TILE).forEach(place);
  });
}

/** Files for tests: the blocks of a file in pages of another size, and with faults in what tells of them. */

import { BLOCK, NO_TILE } from "./constants.js";
import { crc32 } from "./crc32.js";

/**
 * @typedef {import("./container.js").Container} Container
 * @typedef {{kind: number, flags: number, length: number, count: number, crc32: number}} Row
 * @typedef {{gap: bigint, tile_bytes: number, tile_crc32: number, rows: RowTold[]}} PageTold
 * @typedef {{row_bytes: number, row_crc32: number, block_bytes: number, anchors: number}} RowTold
 * @typedef {{depth: number[], shift: number[], gap: bigint[]}} TilePage
 * @typedef {{length: number[], count: number[], crc32: number[]}} RowPage
 * @typedef {{models: Row[][], pages: PageTold[]}} Root
 * @typedef {{root: Root, tiles: TilePage[], rows: RowPage[][]}} Directory `rows` by layer, then page
 * @typedef {{pageBits?: number, change?: (directory: Directory) => void, lie?: (root: Root) => void}} Options
 *   `change` is called before lengths and checksums of pages are put into ROOT, `lie` after it
 */

const DEEPEST = 21;
const FIXED = 100;
const SUMMARY = 136;

/**
 * The blocks of a container in a file of their own.
 * @param {Container} container
 * @param {Options} [options]
 * @returns {Uint8Array}
 */
export function repack(container, { pageBits = 10, change = () => {}, lie = () => {} } = {}) {
  const { header, layers, source } = container;
  const directory = describe(container, 2 ** pageBits);
  change(directory);
  const tiles = directory.tiles.map(packedTiles);
  const rows = directory.rows.map((pages) => pages.map(packedRows));
  settle(directory.root, tiles, rows);
  lie(directory.root);
  const root = packedRoot(directory.root);
  const pages = joined([...tiles, ...rows.flat()]);
  const start = layers[0].end_offset - layers[0].byte_count;
  const moved = header.header_length + root.length + pages.length - start;
  const head = source.read(0, header.header_length).slice();
  const view = new DataView(head.buffer);
  const shift = (/** @type {number} */ at) => view.setBigUint64(at, view.getBigUint64(at, true) + BigInt(moved), true);
  shift(16);
  layers.forEach((_, i) => shift(FIXED + SUMMARY * i + 24));
  head[10] = 2;
  head[31] = pageBits;
  view.setUint32(36, root.length, true);
  view.setUint32(96, crc32(root), true);
  view.setUint32(head.length - 4, crc32(head.subarray(0, -4)), true);
  return joined([head, root, pages, source.read(start, header.file_length - start)]);
}

/** @param {Container} container @param {number} size tiles of a page @returns {Directory} */
function describe({ header, layers, tiles, entries }, size) {
  const firsts = Array.from({ length: Math.ceil(header.tile_count / size) }, (_, p) => p * size);
  const rowOf = (/** @type {number} */ e) => ({
    kind: entries.kind[e],
    flags: entries.flags[e],
    length: entries.length[e],
    count: entries.count[e],
    crc32: entries.crc32[e],
  });
  const all = [...entries.kind.keys()];
  const models = layers.map((_, i) => all.filter((e) => entries.layer[e] === i + 1 && entries.tile[e] === NO_TILE));
  const found = new Map(all.map((e) => [`${entries.layer[e]} ${entries.kind[e]} ${entries.tile[e]}`, e]));
  const rows = layers.map((_, i) =>
    firsts.map((first) => {
      const numbers = Array.from({ length: Math.min(size, header.tile_count - first) }, (_, t) => first + t);
      const own = numbers.map((tile) => found.get(`${i + 1} ${BLOCK.TILE} ${tile}`));
      const there = own.filter((e) => e !== undefined);
      return {
        length: own.map((e) => (e === undefined ? 0 : entries.length[e])),
        count: there.map((e) => entries.count[e]),
        crc32: there.map((e) => entries.crc32[e]),
      };
    }),
  );
  const begins = (/** @type {number} */ t) => tiles.prefix[t] << BigInt(3 * (DEEPEST - tiles.depth[t]));
  const told = firsts.map((first, p) => ({
    gap: begins(first) - (p === 0 ? 0n : begins(firsts[p - 1])),
    tile_bytes: 0,
    tile_crc32: 0,
    rows: rows.map((pages) => sums(pages[p])),
  }));
  const last = (/** @type {number} */ first) => Math.min(first + size, header.tile_count);
  const pages = firsts.map((first) => gapsOf(tiles, begins(first), first, last(first)));
  return { root: { models: models.map((list) => list.map(rowOf)), pages: told }, tiles: pages, rows };
}

/** @param {RowPage} page @returns {RowTold} */
function sums({ length, count }) {
  const sum = (/** @type {number[]} */ list) => list.reduce((a, b) => a + b, 0);
  return { row_bytes: 0, row_crc32: 0, block_bytes: sum(length), anchors: sum(count) };
}

/** @param {Container["tiles"]} tiles @param {bigint} base @param {number} from @param {number} to @returns {TilePage} */
function gapsOf({ depth, shift, prefix }, base, from, to) {
  let past = base;
  const gap = Array.from(prefix.subarray(from, to), (code, i) => {
    const free = BigInt(3 * (DEEPEST - depth[from + i]));
    const least = (past + (1n << free) - 1n) >> free;
    past = (code + 1n) << free;
    return code - least;
  });
  return { depth: [...depth.subarray(from, to)], shift: [...shift.subarray(from, to)], gap };
}

/** Puts lengths and checksums of pages into ROOT. @param {Root} root @param {Uint8Array[]} tiles @param {Uint8Array[][]} rows */
function settle({ pages }, tiles, rows) {
  pages.forEach((page, p) => {
    page.tile_bytes = tiles[p].length;
    page.tile_crc32 = crc32(tiles[p]);
    page.rows.forEach((row, i) => {
      row.row_bytes = rows[i][p].length;
      row.row_crc32 = crc32(rows[i][p]);
    });
  });
}

/** @param {Root} root @returns {Uint8Array} */
function packedRoot({ models, pages }) {
  const out = models.flatMap((rows) => [
    varint(rows.length),
    ...rows.flatMap((row) => [[row.kind, row.flags], varint(row.length), varint(row.count), u32(row.crc32)]),
  ]);
  for (const page of pages) {
    out.push(varint(page.gap), varint(page.tile_bytes), u32(page.tile_crc32));
    for (const row of page.rows) {
      out.push(varint(row.row_bytes));
      if (row.row_bytes > 0) out.push(u32(row.row_crc32), varint(row.block_bytes), varint(row.anchors));
    }
  }
  return Uint8Array.from(out.flat());
}

/** @param {TilePage} page @returns {Uint8Array} */
function packedTiles({ depth, shift, gap }) {
  return Uint8Array.from([...depth, ...shift, ...gap.flatMap(varint)]);
}

/** @param {RowPage} page @returns {Uint8Array} none where no tile has a block */
function packedRows({ length, count, crc32: crcs }) {
  if (crcs.length === 0) return new Uint8Array(0);
  return Uint8Array.from([...length.flatMap(varint), ...count.flatMap(varint), ...crcs.flatMap(u32)]);
}

/** @param {number | bigint} value @returns {number[]} */
export function varint(value) {
  const out = [];
  let left = BigInt(value);
  for (; left >= 0x80n; left >>= 7n) out.push(Number(left & 0x7fn) | 0x80);
  return [...out, Number(left)];
}

/** @param {number} value @returns {number[]} */
function u32(value) {
  return [0, 8, 16, 24].map((bits) => (value >>> bits) & 255);
}

/** @param {Uint8Array[]} parts @returns {Uint8Array} */
function joined(parts) {
  const whole = new Uint8Array(parts.reduce((sum, { length }) => sum + length, 0));
  let at = 0;
  for (const part of parts) {
    whole.set(part, at);
    at += part.length;
  }
  return whole;
}

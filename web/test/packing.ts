/** Files for tests: the blocks of a file in pages of another size, copied, or with faults in the directory. */

import type { Cube } from "../src/decoder/types.js";
import { crc32 } from "../src/format/crc32.js";
import { directoryEnd } from "../src/format/header.js";
import { BLOCK, MAX_DEPTH } from "../src/format/registry.js";
import type { FileBlock, WholeFile } from "./files.js";

type Row = Pick<FileBlock, "kind" | "flags" | "length" | "count" | "crc32">;

export interface TilePage {
  depth: number[];
  shift: number[];
  gap: bigint[];
}

interface RowPage {
  length: number[];
  count: number[];
  crc32: number[];
}

export interface PackedRoot {
  /** By layer - 1. */
  models: Row[][];
  pages: {
    gap: bigint;
    tile_bytes: number;
    tile_crc32: number;
    rows: { row_bytes: number; row_crc32: number; block_bytes: number; anchors: number }[];
  }[];
}

export interface PackedDirectory {
  root: PackedRoot;
  tiles: TilePage[];
  /** By layer - 1, then page. */
  rows: RowPage[][];
}

export interface Packing {
  pageBits?: number;
  /** Called before lengths and checksums of pages are put into ROOT. */
  change?: (directory: PackedDirectory) => void;
  /** Called after it. */
  lie?: (root: PackedRoot) => void;
}

const FIXED = 100;
const SUMMARY = 136;

/** What a file is made of: its header as it is, the cubes of its tiles, its blocks in order, and their bytes. */
interface Content {
  head: Uint8Array;
  layers: number;
  cubes: Cube[];
  blocks: FileBlock[];
  data: Uint8Array;
}

/** The blocks of a file in pages of 2^pageBits tiles, 1024 unless given. */
export function repack({ bytes, cubes, blocks, front: { header, layers } }: WholeFile, packing: Packing = {}): Uint8Array {
  const head = bytes.slice(0, header.header_length);
  const start = directoryEnd(layers);
  return pack({ head, layers: layers.length, cubes, blocks, data: bytes.subarray(start) }, start, packing);
}

/**
 * 8^doublings copies of a scene, its cube doubled so many times: a tile of copy c is c times as many tiles further on.
 * Blocks of tiles are there as often as copies, those of no tile once.
 */
export function replicated(file: WholeFile, doublings: number, pageBits: number): Uint8Array {
  const times = 8 ** doublings;
  const { header, layers } = file.front;
  const n = header.tile_count;
  const copies = Array.from({ length: times }, (_, copy) => copy);
  const blocks = layers.flatMap((_, i) => {
    const own = file.blocks.filter(({ layer }) => layer === i + 1);
    return [
      ...own.filter(({ kind }) => kind < BLOCK.TILE),
      ...copies.flatMap((copy) => own.flatMap((one) => (one.tile === null ? [] : { ...one, tile: copy * n + one.tile }))),
      ...own.filter(({ kind }) => kind > BLOCK.TILE),
    ];
  });
  const cubes = copies.flatMap((copy) =>
    file.cubes.map(({ depth, shift, prefix }) => {
      return { depth: depth + doublings, shift, prefix: (BigInt(copy) << BigInt(3 * depth)) | prefix };
    }),
  );
  const head = file.bytes.slice(0, header.header_length);
  const view = new DataView(head.buffer);
  const put = (at: number, value: number) => view.setBigUint64(at, BigInt(value), true);
  let end = header.header_length;
  layers.forEach(({ anchor_count, gaussian_count, stream_bytes }, i) => {
    const streams = stream_bytes.map((size, stream) => (stream === 0 ? size : size * times));
    const total = streams.reduce((a, b) => a + b, 0);
    end += total;
    const numbers = [anchor_count * times, gaussian_count * times, total, end, ...streams];
    numbers.forEach((value, at) => put(FIXED + SUMMARY * i + 8 * at, value));
  });
  view.setUint8(28, header.lattice_bits + doublings);
  view.setUint32(32, n * times, true);
  put(16, end);
  put(40, header.anchor_count * times);
  put(48, header.gaussian_count * times);
  const data = joined(blocks.map((block) => file.body(block)));
  return pack({ head, layers: layers.length, cubes, blocks, data }, header.header_length, { pageBits });
}

/** @param start where blocks begin by the offsets in `head` */
function pack(content: Content, start: number, { pageBits = 10, change = () => {}, lie = () => {} }: Packing): Uint8Array {
  const { head, layers, data } = content;
  const directory = describe(content, 2 ** pageBits);
  change(directory);
  const tiles = directory.tiles.map(packedTiles);
  const rows = directory.rows.map((pages) => pages.map(packedRows));
  describePages(directory.root, tiles, rows);
  lie(directory.root);
  const root = packedRoot(directory.root);
  const pages = joined([...tiles, ...rows.flat()]);
  const moved = head.length + root.length + pages.length - start;
  const view = new DataView(head.buffer);
  const move = (at: number) => view.setBigUint64(at, view.getBigUint64(at, true) + BigInt(moved), true);
  move(16);
  for (let i = 0; i < layers; i++) move(FIXED + SUMMARY * i + 24);
  head[31] = pageBits;
  view.setUint32(36, root.length, true);
  view.setUint32(96, crc32(root), true);
  view.setUint32(head.length - 4, crc32(head.subarray(0, -4)), true);
  return joined([head, root, pages, data]);
}

/** @param size tiles of a page */
function describe({ layers, cubes, blocks }: Content, size: number): PackedDirectory {
  const inPages = <T>(all: T[]) => Array.from({ length: Math.ceil(all.length / size) }, (_, p) => all.slice(p * size, (p + 1) * size));
  const ofLayer = Array.from({ length: layers }, (_, i) => blocks.filter(({ layer }) => layer === i + 1));
  const rows = ofLayer.map((own) => {
    const byTile = new Map(own.map((block) => [block.tile, block]));
    return inPages(cubes.map((_, tile) => byTile.get(tile))).map((page) => {
      const there = page.filter((block) => block !== undefined);
      const length = page.map((block) => block?.length ?? 0);
      return { length, count: there.map(({ count }) => count), crc32: there.map((block) => block.crc32) };
    });
  });
  const pages = inPages(cubes);
  const bases = pages.map(([{ depth, prefix }]) => prefix << BigInt(3 * (MAX_DEPTH - depth)));
  const sum = (list: number[]) => list.reduce((a, b) => a + b, 0);
  const root = {
    models: ofLayer.map((own) => own.filter(({ tile }) => tile === null).map((block) => ({ ...block }))),
    pages: bases.map((base, p) => ({
      gap: base - (p === 0 ? 0n : bases[p - 1]),
      tile_bytes: 0,
      tile_crc32: 0,
      rows: rows.map((of) => ({ row_bytes: 0, row_crc32: 0, block_bytes: sum(of[p].length), anchors: sum(of[p].count) })),
    })),
  };
  return { root, tiles: pages.map((page, p) => tilePage(page, bases[p])), rows };
}

function tilePage(cubes: Cube[], base: bigint): TilePage {
  let past = base;
  const gap = cubes.map(({ depth, prefix }) => {
    const free = BigInt(3 * (MAX_DEPTH - depth));
    const least = (past + (1n << free) - 1n) >> free;
    past = (prefix + 1n) << free;
    return prefix - least;
  });
  return { depth: cubes.map(({ depth }) => depth), shift: cubes.map(({ shift }) => shift), gap };
}

/** Puts lengths and checksums of pages into ROOT. */
function describePages({ pages }: PackedRoot, tiles: Uint8Array[], rows: Uint8Array[][]): void {
  pages.forEach((page, p) => {
    page.tile_bytes = tiles[p].length;
    page.tile_crc32 = crc32(tiles[p]);
    page.rows.forEach((row, i) => {
      row.row_bytes = rows[i][p].length;
      row.row_crc32 = crc32(rows[i][p]);
    });
  });
}

function packedRoot({ models, pages }: PackedRoot): Uint8Array {
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

export function packedTiles({ depth, shift, gap }: TilePage): Uint8Array {
  return Uint8Array.from([...depth, ...shift, ...gap.flatMap(varint)]);
}

/** Nothing where no tile has a block. */
function packedRows({ length, count, crc32: crcs }: RowPage): Uint8Array {
  if (crcs.length === 0) return new Uint8Array(0);
  return Uint8Array.from([...length.flatMap(varint), ...count.flatMap(varint), ...crcs.flatMap(u32)]);
}

function varint(value: number | bigint): number[] {
  const out: number[] = [];
  let left = BigInt(value);
  for (; left >= 0x80n; left >>= 7n) out.push(Number(left & 0x7fn) | 0x80);
  return [...out, Number(left)];
}

function u32(value: number): number[] {
  return [0, 8, 16, 24].map((bits) => (value >>> bits) & 255);
}

function joined(parts: Uint8Array[]): Uint8Array {
  return new Uint8Array(Buffer.concat(parts));
}

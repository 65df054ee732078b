/** Files for tests: the blocks of a file in pages of another size. */

import type { Cube } from "../src/decoder/types.js";
import { crc32 } from "../src/format/crc32.js";
import { directoryEnd } from "../src/format/header.js";
import { MAX_DEPTH } from "../src/format/registry.js";
import type { FileBlock, WholeFile } from "./files.js";

const FIXED = 100;
const SUMMARY = 136;
/** Where headers and summaries say where something ends. */
const [FILE_LENGTH, END_OFFSET] = [16, FIXED + 24];

/** The row page of a layer, and what ROOT says of it. */
interface RowPage {
  bytes: Uint8Array;
  blockBytes: number;
  anchors: number;
}

/**
 * The blocks of a file in pages of 2^pageBits tiles, 1024 unless given.
 * @param change may change tile pages before their checksums are taken
 */
export function repack(file: WholeFile, pageBits = 10, change: (tilePages: Uint8Array[]) => void = () => undefined): Uint8Array {
  const { bytes, cubes, blocks } = file;
  const { header, layers } = file.front;
  const inPages = <T>(all: T[]) => {
    const size = 2 ** pageBits;
    return Array.from({ length: Math.ceil(all.length / size) }, (_, p) => all.slice(p * size, (p + 1) * size));
  };
  const pages = inPages(cubes);
  const bases = pages.map(([{ depth, prefix }]) => prefix << BigInt(3 * (MAX_DEPTH - depth)));
  const tilePages = pages.map((page, p) => tilePage(page, bases[p]));
  change(tilePages);
  const rows = layers.map((_, i) => {
    const byTile = new Map(blocks.filter(({ layer }) => layer === i + 1).map((block) => [block.tile, block]));
    return inPages(cubes.map((_, tile) => byTile.get(tile))).map(rowPage);
  });
  const models = layers.flatMap((_, i) => modelsOf(blocks.filter(({ layer, tile }) => layer === i + 1 && tile === null)));
  const described = bases.map((base, p) => {
    const gap = base - (p === 0 ? 0n : bases[p - 1]);
    return [...varint(gap), ...varint(tilePages[p].length), ...u32(crc32(tilePages[p])), ...rows.flatMap((of) => describedRows(of[p]))];
  });
  const root = Uint8Array.from([...models, ...described.flat()]);
  const directory = joined([root, ...tilePages, ...rows.flat().map((page) => page.bytes)]);
  const start = directoryEnd(layers);
  const head = movedHeader(bytes.slice(0, header.header_length), layers.length, header.header_length + directory.length - start);
  head[31] = pageBits;
  const view = new DataView(head.buffer);
  view.setUint32(36, root.length, true);
  view.setUint32(96, crc32(root), true);
  view.setUint32(head.length - 4, crc32(head.subarray(0, -4)), true);
  return joined([head, directory, bytes.subarray(start)]);
}

/** A header in which all blocks lie so many bytes later. */
function movedHeader(head: Uint8Array, layers: number, bytes: number): Uint8Array {
  const view = new DataView(head.buffer);
  const ends = Array.from({ length: layers }, (_, i) => END_OFFSET + SUMMARY * i);
  for (const at of [FILE_LENGTH, ...ends]) view.setBigUint64(at, view.getBigUint64(at, true) + BigInt(bytes), true);
  return head;
}

function tilePage(cubes: Cube[], base: bigint): Uint8Array {
  let past = base;
  const gaps = cubes.map(({ depth, prefix }) => {
    const free = BigInt(3 * (MAX_DEPTH - depth));
    const least = (past + (1n << free) - 1n) >> free;
    past = (prefix + 1n) << free;
    return prefix - least;
  });
  return Uint8Array.from([...cubes.map(({ depth }) => depth), ...cubes.map(({ shift }) => shift), ...gaps.flatMap(varint)]);
}

/** No bytes where no tile has a block. */
function rowPage(blocks: (FileBlock | undefined)[]): RowPage {
  const there = blocks.filter((block) => block !== undefined);
  const lengths = blocks.map((block) => block?.length ?? 0);
  const bytes = [...lengths.flatMap(varint), ...there.flatMap(({ count }) => varint(count)), ...there.flatMap((block) => u32(block.crc32))];
  const anchors = there.reduce((sum, { count }) => sum + count, 0);
  return { bytes: Uint8Array.from(there.length > 0 ? bytes : []), blockBytes: lengths.reduce((a, b) => a + b, 0), anchors };
}

function modelsOf(blocks: FileBlock[]): number[] {
  const rows = blocks.flatMap((row) => [row.kind, row.flags, ...varint(row.length), ...varint(row.count), ...u32(row.crc32)]);
  return [...varint(blocks.length), ...rows];
}

function describedRows({ bytes, blockBytes, anchors }: RowPage): number[] {
  if (bytes.length === 0) return varint(0);
  return [...varint(bytes.length), ...u32(crc32(bytes)), ...varint(blockBytes), ...varint(anchors)];
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

/** Files that the tests read, as a whole: a scene of several tiles, and the vectors of the conformance suite. */

import { readFileSync } from "node:fs";
import { join } from "node:path";
import { inflateRawSync } from "node:zlib";
import type { Cube } from "../src/decoder/types.js";
import { WasmDecoder } from "../src/decoder/wasm.js";
import { type Directory, openPages, parseFront } from "../src/format/directory.js";
import type { RootBlock } from "../src/format/root.js";
import { BLOCK } from "../src/format/registry.js";

/** The repository; tests run from web/. */
const REPOSITORY = join(process.cwd(), "..");

export function readBytes(path: string): Uint8Array {
  return new Uint8Array(readFileSync(path));
}

/** 10,914 Gaussians, 24 tiles in 12 pages, 5 layers; test/data/README.md says how it was made. */
export const toys = () => readBytes(join(REPOSITORY, "web/test/data/toys.scar"));

/** A vector of the suite, `class/name`: a member of the archive of its class. */
export function vector(name: string): Uint8Array {
  const [archive, folder] = name.split("/");
  return member(readFileSync(join(REPOSITORY, "conformance/vectors", `${archive}.zip`)), `vectors/${archive}/${folder}/input.scar`);
}

/** A member of a zip archive, by its directory at the end. */
function member(zip: Buffer, name: string): Uint8Array {
  const end = zip.lastIndexOf("PK\x05\x06");
  let at = zip.readUInt32LE(end + 16);
  for (let left = zip.readUInt16LE(end + 10); left > 0; left--) {
    const [length, extra, comment] = [28, 30, 32].map((field) => zip.readUInt16LE(at + field));
    if (zip.toString("utf8", at + 46, at + 46 + length) === name) {
      const [method, size, local] = [zip.readUInt16LE(at + 10), zip.readUInt32LE(at + 20), zip.readUInt32LE(at + 42)];
      const start = local + 30 + zip.readUInt16LE(local + 26) + zip.readUInt16LE(local + 28);
      const data = zip.subarray(start, start + size);
      return new Uint8Array(method === 0 ? data : inflateRawSync(data));
    }
    at += 46 + length + extra + comment;
  }
  throw new Error(`the archive has no ${name}`);
}

/** The module that build.mjs has made, beside the folder of the built tests. */
export const compiledModule = () => new WebAssembly.Module(readFileSync(new URL("../scar.wasm", import.meta.url)));

const compiled = compiledModule();
export const decoder = () => new WasmDecoder(compiled);

/** The front of a whole file: every page open. */
export function openedFront(bytes: Uint8Array): Directory {
  const front = parseFront(bytes, bytes.length);
  openPages(front, bytes);
  return front;
}

/** A block of a file; `tile` is null for one of no tile. */
export interface FileBlock extends Omit<RootBlock, "at"> {
  tile: number | null;
}

/** All blocks of a file in the order in which they lie. */
export function blocksOf({ numbers, entries, index, header }: Directory): FileBlock[] {
  const found: FileBlock[] = [];
  for (let layer = 1; layer <= header.layer_count; layer++) {
    const others = numbers.blocksOf(layer).map(({ block: { at: _, ...block } }) => ({ ...block, tile: null }));
    found.push(...others.filter(({ kind }) => kind < BLOCK.TILE));
    for (let tile = 0; tile < index.tiles; tile++) {
      const entry = numbers.tileBlock(tile, layer);
      const [offset, length, crc32] = [entries.offset[entry], entries.length[entry], entries.crc32[entry]];
      const count = index.counts[tile * index.layers + layer - 1];
      if (length > 0) found.push({ kind: BLOCK.TILE, flags: 1, layer, tile, offset, length, count, crc32 });
    }
    found.push(...others.filter(({ kind }) => kind > BLOCK.TILE));
  }
  return found;
}

/** A file with its directory read. */
export class WholeFile {
  readonly front: Directory;
  readonly blocks: FileBlock[];

  constructor(readonly bytes: Uint8Array) {
    this.front = openedFront(bytes);
    this.blocks = blocksOf(this.front);
  }

  get cubes(): Cube[] {
    return Array.from({ length: this.front.index.tiles }, (_, tile) => this.front.cube(tile));
  }

  find(kind: number, layer: number, tile: number | null = null): FileBlock | undefined {
    return this.blocks.find((block) => block.kind === kind && block.layer === layer && block.tile === tile);
  }

  /** A copy of the bytes of a block. */
  body({ offset, length }: FileBlock): Uint8Array {
    return this.bytes.slice(offset, offset + length);
  }
}

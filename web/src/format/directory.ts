/** The directory of a file (SPEC §5.4, §5.5): ROOT at first, then page after page as they arrive. */

import type { Cube } from "../decoder/types.js";
import type { FileIndex } from "../plan/types.js";
import { writeBox, writeRangeBox } from "./cubes.js";
import { type Header, readHeader, type Summary } from "./header.js";
import { Numbering } from "./numbering.js";
import { type Cubes, readRowPage, readTilePage } from "./pages.js";
import { BLOCK } from "./registry.js";
import { PAST_ALL, readRoot, type Root, tilesInPage } from "./root.js";

/** Where pages and blocks are. */
export interface Entries {
  /** Of what is in a page that is not open, where the first block of the page is. */
  offset: Float64Array;
  /** 0 for what is not there, or not yet known. */
  length: Float64Array;
  crc32: Uint32Array;
}

/** What is known of a scene before any of its data. */
export interface Front {
  header: Header;
  /** Layers, with anchors, Gaussians and bytes after each. */
  layers: Summary[];
  /**
   * Boxes and sizes of tiles. Of a tile whose pages have not come, the box is that of its page, and sizes are means over
   * the page; they are put right in place.
   */
  index: FileIndex;
  /** Gaussians of all tiles after the last layer; slots that stay off included. */
  total: number;
}

export class Directory implements Front {
  readonly index: FileIndex;
  readonly total: number;
  readonly numbers: Numbering;
  readonly entries: Entries;
  /** (tiles) */
  readonly #cubes: Cubes;
  /** Pages by their entries: 1 where open, or where there is none. */
  readonly #open: Uint8Array;

  constructor(
    readonly header: Header,
    readonly layers: Summary[],
    readonly root: Root,
  ) {
    const { tile_count: tiles, layer_count: k } = header;
    this.total = header.anchor_count * header.slots;
    this.numbers = new Numbering(root, tiles, k);
    const { count } = this.numbers;
    this.entries = { offset: new Float64Array(count), length: new Float64Array(count), crc32: new Uint32Array(count) };
    this.index = {
      tiles,
      layers: k,
      slots: header.slots,
      boxes: new Float64Array(6 * tiles),
      bytes: new Float64Array(tiles * k),
      counts: new Uint32Array(tiles * k),
      streaming: null,
    };
    this.#cubes = {
      depth: new Uint8Array(tiles),
      shift: new Uint8Array(tiles),
      prefix: new BigUint64Array(tiles),
    };
    this.#open = new Uint8Array(root.pages * (1 + k));
    this.#placePages();
    for (let layer = 1; layer <= k; layer++) this.#placeBlocks(layer);
  }

  /** Entries of pages come first. */
  get pageEntries(): number {
    return this.#open.length;
  }

  isOpen(page: number): boolean {
    return this.#open[page] === 1;
  }

  /** Whether it is known where a tile is. */
  isPlaced(tile: number): boolean {
    return this.isOpen(this.numbers.tilePage(this.pageOf(tile)));
  }

  /** Whether a tile is known to have no block in a layer. */
  hasNoBlock(tile: number, layer: number): boolean {
    const row = this.numbers.rowPage(layer, this.pageOf(tile));
    return this.isOpen(row) && this.entries.length[this.numbers.tileBlock(tile, layer)] === 0;
  }

  pageOf(tile: number): number {
    return Math.floor(tile / 2 ** this.header.page_bits);
  }

  /** Tiles of a page: the first, and the one after the last. */
  tilesOf(page: number): [number, number] {
    const first = page * 2 ** this.header.page_bits;
    return [first, first + tilesInPage(this.header, page)];
  }

  /** Where a tile is, once its page is open. */
  cube(tile: number): Cube {
    const { depth, shift, prefix } = this.#cubes;
    return { depth: depth[tile], shift: shift[tile], prefix: prefix[tile] };
  }

  /** Anchors that appear in a layer of a tile. */
  appear(tile: number, layer: number): number {
    return this.index.counts[tile * this.index.layers + layer - 1];
  }

  /** Takes a page, once. Throws a refusal where it breaks a rule of §5.5. @param entry one of `pageEntries` */
  openPage(entry: number, bytes: Uint8Array): void {
    const part = this.numbers.partOf(entry);
    if (part.what === "tiles") this.#openTiles(part.page, bytes);
    else if (part.what === "rows") this.#openRows(part.layer, part.page, bytes);
    this.#open[entry] = 1;
  }

  #placePages(): void {
    const { tilePages, rowPages, pages } = this.root;
    [tilePages, ...rowPages].forEach(({ offset, length, crc32 }, i) => {
      this.entries.offset.set(offset, i * pages);
      this.entries.length.set(length, i * pages);
      this.entries.crc32.set(crc32, i * pages);
    });
    this.entries.length.subarray(0, this.pageEntries).forEach((length, e) => (this.#open[e] = length === 0 ? 1 : 0));
    const box = new Float64Array(6);
    for (let page = 0; page < pages; page++) {
      const past = page === pages - 1 ? PAST_ALL : this.root.base[page + 1];
      writeRangeBox(box, this.header, this.root.base[page], past);
      const [first, end] = this.tilesOf(page);
      for (let tile = first; tile < end; tile++) this.index.boxes.set(box, 6 * tile);
    }
  }

  #placeBlocks(layer: number): void {
    const { offset, length, crc32 } = this.entries;
    const { end_offset, byte_count } = this.layers[layer - 1];
    let at = end_offset - byte_count;
    for (const { entry, block } of this.numbers.blocksOf(layer)) {
      offset[entry] = block.offset;
      length[entry] = block.length;
      crc32[entry] = block.crc32;
      if (block.kind < BLOCK.TILE) at += block.length;
    }
    this.root.rowPages[layer - 1].blockBytes.forEach((bytes, page) => {
      this.#estimate(layer, page, at);
      at += bytes;
    });
  }

  /** Before its row page has come, all tiles of a page are alike. */
  #estimate(layer: number, page: number, at: number): void {
    const { blockBytes, anchors } = this.root.rowPages[layer - 1];
    const { layers, bytes, counts } = this.index;
    const [first, end] = this.tilesOf(page);
    for (let tile = first; tile < end; tile++) {
      this.entries.offset[this.numbers.tileBlock(tile, layer)] = at;
      bytes[tile * layers + layer - 1] = blockBytes[page] / (end - first);
      counts[tile * layers + layer - 1] = Math.ceil(anchors[page] / (end - first));
    }
  }

  #openTiles(page: number, bytes: Uint8Array): void {
    const [first, end] = this.tilesOf(page);
    const { depth, shift, prefix } = readTilePage(bytes, this.header, this.root, page);
    this.#cubes.depth.set(depth, first);
    this.#cubes.shift.set(shift, first);
    this.#cubes.prefix.set(prefix, first);
    for (let tile = first; tile < end; tile++) {
      writeBox(this.index.boxes.subarray(6 * tile, 6 * tile + 6), this.header, this.cube(tile));
    }
  }

  #openRows(layer: number, page: number, bytes: Uint8Array): void {
    const rows = readRowPage(bytes, this.header, this.root, layer, page);
    const [first, end] = this.tilesOf(page);
    const entry = this.numbers.tileBlock(first, layer);
    this.entries.length.set(rows.length, entry);
    this.entries.crc32.set(rows.crc32, entry);
    let at = this.entries.offset[entry];
    for (let tile = first; tile < end; tile++) {
      const key = tile * this.index.layers + layer - 1;
      this.entries.offset[entry + tile - first] = at;
      this.index.bytes[key] = rows.length[tile - first];
      this.index.counts[key] = rows.count[tile - first];
      at += rows.length[tile - first];
    }
  }
}

/**
 * Bytes of header and ROOT. Throws Refused where the header breaks a rule.
 * @param bytes the first MOST_HEADER bytes, or the whole of a shorter file
 * @param size of the file, null where the server does not say
 */
export function frontLength(bytes: Uint8Array, size: number | null): number {
  const { header } = readHeader(bytes, size);
  return header.header_length + header.root_length;
}

/** Throws Refused where header or ROOT break a rule of §5. @param bytes header and ROOT, or more @param size of the file */
export function parseFront(bytes: Uint8Array, size: number | null): Directory {
  const { header, layers } = readHeader(bytes, size);
  return new Directory(header, layers, readRoot(bytes, size ?? header.file_length, header, layers));
}

/** Opens every page that lies whole within the first bytes of a file. Throws Refused where one breaks a rule of §5.5. */
export function openPages(directory: Directory, bytes: Uint8Array): void {
  const { offset, length } = directory.entries;
  for (let page = 0; page < directory.pageEntries; page++) {
    const end = offset[page] + length[page];
    if (!directory.isOpen(page) && end <= bytes.length) directory.openPage(page, bytes.subarray(offset[page], end));
  }
}

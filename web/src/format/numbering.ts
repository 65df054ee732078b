/** Numbers of pages and blocks, in the order in which they lie in the file. Nothing has to be read to know them. */

import { BLOCK } from "./registry.js";
import type { Root, RootBlock } from "./root.js";

/** What a number stands for. */
export type Part =
  | { what: "tiles"; page: number }
  | { what: "rows"; page: number; layer: number }
  | { what: "tile"; tile: number; layer: number }
  | { what: "block"; block: RootBlock; layer: number };

/** Of a layer. */
interface Run {
  /** Number of the first block of no tile that lies before the TILE blocks, of the first TILE block, and behind them. */
  models: number;
  tiles: number;
  others: number;
  blocks: RootBlock[];
}

/** A number is an entry, whether it is of a page or of a block; tiles have one in every layer, used or not. */
export class Numbering {
  readonly count: number;
  readonly #runs: Run[];

  constructor(
    readonly root: Root,
    readonly tiles: number,
    layers: number,
  ) {
    let next = root.pages * (1 + layers);
    this.#runs = Array.from({ length: layers }, (_, i) => {
      const blocks = root.blocks.filter(({ layer }) => layer === i + 1);
      const models = next;
      const first = models + blocks.filter(({ kind }) => kind < BLOCK.TILE).length;
      const others = first + tiles;
      next = models + blocks.length + tiles;
      return { models, tiles: first, others, blocks };
    });
    this.count = next;
  }

  tilePage(page: number): number {
    return page;
  }

  rowPage(layer: number, page: number): number {
    return layer * this.root.pages + page;
  }

  tileBlock(tile: number, layer: number): number {
    return this.#runs[layer - 1].tiles + tile;
  }

  /** Entries of what a layer needs besides its tiles. */
  models(layer: number): number[] {
    const { models, blocks } = this.#runs[layer - 1];
    return blocks.flatMap(({ kind }, i) => (kind < BLOCK.THUMBNAIL ? [models + i] : []));
  }

  /** The entry of a block of layer 1 that belongs to no tile, -1 where there is none. */
  blockOfFirst(kind: number): number {
    const { blocks } = this.#runs[0] ?? { blocks: [] };
    const found = blocks.findIndex((block) => block.kind === kind);
    return found < 0 ? -1 : this.#entryOf(1, found);
  }

  partOf(entry: number): Part {
    const { pages } = this.root;
    if (entry < pages) return { what: "tiles", page: entry };
    const first = this.#runs[0]?.models ?? this.count;
    if (entry < first) return { what: "rows", layer: Math.floor(entry / pages), page: entry % pages };
    const layer = this.#runs.findLastIndex(({ models }) => models <= entry) + 1;
    const { models, tiles, others, blocks } = this.#runs[layer - 1];
    if (entry >= tiles && entry < others) return { what: "tile", tile: entry - tiles, layer };
    return { what: "block", block: blocks[entry < tiles ? entry - models : entry - models - this.tiles], layer };
  }

  /** Entries of all blocks of a layer that belong to no tile, with what ROOT says of them. */
  blocksOf(layer: number): { entry: number; block: RootBlock }[] {
    return this.#runs[layer - 1].blocks.map((block, i) => ({ entry: this.#entryOf(layer, i), block }));
  }

  /** @param i of the blocks of the layer that belong to no tile */
  #entryOf(layer: number, i: number): number {
    const { models, tiles } = this.#runs[layer - 1];
    return models + i < tiles ? models + i : models + i + this.tiles;
  }
}

/** Feeding a decoder from a whole file, as a stream does from parts of it. */

import { BLOCK } from "../../conformance/decoders/js/constants.js";
import { findBlock } from "../../conformance/decoders/js/container.js";
import { openScar } from "../../conformance/decoders/js/decoder.js";
import type { Block, Cube, TileBlock, TileDecoder } from "../src/decoder/types.js";

export class Feeder {
  readonly #scar;

  constructor(
    readonly decoder: TileDecoder,
    readonly bytes: Uint8Array,
  ) {
    this.#scar = openScar(bytes);
    const { header_length, root_length } = this.#scar.header;
    decoder.open(bytes.slice(0, header_length + root_length));
  }

  get layers(): number {
    return this.#scar.header.layer_count;
  }

  get tiles(): number {
    return this.#scar.header.tile_count;
  }

  /** Blocks of a layer that belong to no tile. */
  blocks(layer: number): Block[] {
    const { entries } = this.#scar.container;
    const chosen = [...entries.kind.keys()].filter((e) => entries.layer[e] === layer && entries.kind[e] !== BLOCK.TILE);
    return chosen.map((e) => ({ kind: entries.kind[e], body: this.#body(e) }));
  }

  addModels(layer: number): void {
    this.decoder.addModels(layer, this.blocks(layer));
  }

  cube(tile: number): Cube {
    const { depth, shift, prefix } = this.#scar.container.tiles;
    return { depth: depth[tile], shift: shift[tile], prefix: prefix[tile] };
  }

  /** The TILE block of a tile, with an empty body where there is none. */
  block(tile: number, layer: number): TileBlock {
    const { container } = this.#scar;
    const e = findBlock(container, layer, BLOCK.TILE, tile);
    if (e < 0) return { layer, offset: 0, count: 0, body: new Uint8Array(0) };
    return { layer, offset: container.entries.offset[e], count: container.entries.count[e], body: this.#body(e) };
  }

  advance(tile: number, layer: number): void {
    this.decoder.advance(tile, this.cube(tile), this.block(tile, layer));
  }

  /** Models and tiles of layers 1..k, tile by tile. */
  decodeTo(layer: number): void {
    for (let k = 1; k <= layer; k++) this.addModels(k);
    for (let tile = 0; tile < this.tiles; tile++) for (let k = 1; k <= layer; k++) this.advance(tile, k);
  }

  #body(e: number): Uint8Array {
    const { offset, length } = this.#scar.container.entries;
    return this.bytes.slice(offset[e], offset[e] + length[e]);
  }
}

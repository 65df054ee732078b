/** Feeding a decoder from a whole file, as a stream does from parts of it. */

import type { Block, Cube, TileBlock } from "../src/decoder/types.js";
import type { WasmDecoder } from "../src/decoder/wasm.js";
import { BLOCK } from "../src/format/registry.js";
import { decoder as newDecoder, WholeFile } from "./files.js";

export class Feeder {
  readonly file: WholeFile;

  constructor(
    bytes: Uint8Array,
    readonly decoder: WasmDecoder = newDecoder(),
  ) {
    this.file = new WholeFile(bytes);
    const { header_length, root_length } = this.file.front.header;
    this.decoder.open(bytes.slice(0, header_length + root_length));
  }

  get layers(): number {
    return this.file.front.index.layers;
  }

  get tiles(): number {
    return this.file.front.index.tiles;
  }

  /** Blocks of a layer that belong to no tile. */
  blocks(layer: number): Block[] {
    const chosen = this.file.blocks.filter((block) => block.layer === layer && block.tile === null);
    return chosen.map((block) => ({ kind: block.kind, body: this.file.body(block) }));
  }

  addModels(layer: number): void {
    this.decoder.addModels(layer, this.blocks(layer));
  }

  cube(tile: number): Cube {
    return this.file.front.cube(tile);
  }

  /** The TILE block of a tile, with an empty body where there is none. */
  block(tile: number, layer: number): TileBlock {
    const found = this.file.find(BLOCK.TILE, layer, tile);
    return found === undefined ? { layer, count: 0, body: new Uint8Array(0) } : { layer, count: found.count, body: this.file.body(found) };
  }

  advance(tile: number, layer: number): void {
    this.decoder.advance(tile, this.cube(tile), this.block(tile, layer));
  }

  /** Models and tiles of layers 1..k, tile by tile. */
  decodeTo(layer: number): void {
    for (let k = 1; k <= layer; k++) this.addModels(k);
    for (let tile = 0; tile < this.tiles; tile++) for (let k = 1; k <= layer; k++) this.advance(tile, k);
  }
}

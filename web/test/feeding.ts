/** Feeding a decoder from a whole file, as a stream does from parts of it. */

import { BLOCK, NO_TILE } from "../../conformance/decoders/js/constants.js";
import { openScar } from "../../conformance/decoders/js/decoder.js";
import type { Block, TileDecoder } from "../src/decoder/types.js";

export class Feeder {
  readonly #scar;

  constructor(
    readonly decoder: TileDecoder,
    readonly bytes: Uint8Array,
  ) {
    this.#scar = openScar(bytes);
    decoder.open(bytes.slice(0, this.#scar.container.entries.offset[0]));
  }

  get layers(): number {
    return this.#scar.header.layer_count;
  }

  get tiles(): number {
    return this.#scar.header.tile_count;
  }

  /** Blocks of a layer that are of a tile, or of none. */
  blocks(layer: number, ofTile: boolean): Block[] {
    const { entries } = this.#scar.container;
    const chosen = [...entries.kind.keys()].filter(
      (e) => entries.layer[e] === layer && (entries.tile[e] !== NO_TILE) === ofTile,
    );
    return chosen.map((e) => ({
      kind: entries.kind[e],
      layer,
      tile: entries.tile[e],
      body: this.bytes.slice(entries.offset[e], entries.offset[e] + entries.length[e]),
    }));
  }

  addModels(layer: number): void {
    this.decoder.addModels(layer, this.blocks(layer, false));
  }

  /** The TILE block of a tile, empty where there is none. */
  body(tile: number, layer: number): Uint8Array {
    const found = this.blocks(layer, true).find((block) => block.kind === BLOCK.TILE && block.tile === tile);
    return found?.body ?? new Uint8Array(0);
  }

  advance(tile: number, layer: number): void {
    this.decoder.advance(tile, layer, this.body(tile, layer));
  }

  /** Models and tiles of layers 1..k, tile by tile. */
  decodeTo(layer: number): void {
    for (let k = 1; k <= layer; k++) this.addModels(k);
    for (let tile = 0; tile < this.tiles; tile++) for (let k = 1; k <= layer; k++) this.advance(tile, k);
  }
}

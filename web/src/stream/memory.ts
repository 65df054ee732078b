/** What a tile costs in memory, learnt from what decoders report. */

import type { Output } from "../decoder/protocol.js";
import type { Cost } from "./budget.js";
import type { Tiles } from "./tiles.js";

const FLOAT = 4;
/** Bytes of an anchor in a decoder, before any was measured. */
const FIRST_GUESS = 128;

/** Bytes of one delivered Gaussian. */
function splatBytes(output: Output, degree: number): number {
  if (output === "values") return FLOAT * (3 + 3 + 4 + 1 + 3 * (degree + 1) ** 2);
  return FLOAT * (4 + [0, 2, 6, 10][degree]);
}

export class MemoryModel implements Cost {
  readonly #splatBytes: number;
  #anchorBytes = FIRST_GUESS;
  #modelBytes = 0;

  constructor(
    readonly tiles: Tiles,
    output: Output,
  ) {
    this.#splatBytes = splatBytes(output, tiles.front.header.sh_degree);
  }

  /** Bytes that decoders hold for models. */
  get modelBytes(): number {
    return this.#modelBytes;
  }

  addModels(bytes: number): void {
    this.#modelBytes += Math.max(bytes, 0);
  }

  /** Learns from what all decoders hold with these many anchors in them. */
  observe(memory: number, anchors: number): void {
    if (anchors > 0) this.#anchorBytes = Math.max(this.#anchorBytes, (memory - this.#modelBytes) / anchors);
  }

  splats(tile: number, layer: number): number {
    return this.tiles.splats(tile, layer);
  }

  bytes(tile: number, layer: number): number {
    const splats = this.splats(tile, layer);
    const { layers, slots } = this.tiles.index;
    const kept = layer < layers || this.tiles.keepsComplete ? (splats / slots) * this.#anchorBytes : 0;
    return splats * this.#splatBytes + kept;
  }
}

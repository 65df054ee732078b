/** What a tile costs in memory. */

import type { Output } from "../decoder/protocol.js";
import { inRuns, placeBytes } from "../pack/places.js";
import type { Cost } from "./budget.js";
import type { Tiles } from "./tiles.js";

const FLOAT = 4;
/** Bytes of an anchor in a decoder: 270 to 360 in scenes of degree 3. */
const ANCHOR_BYTES = 320;

/** Bytes of one delivered Gaussian. */
function splatBytes(output: Output, degree: number): number {
  if (output === "values") return FLOAT * (3 + 3 + 4 + 1 + 3 * (degree + 1) ** 2);
  return placeBytes(degree);
}

export class MemoryModel implements Cost {
  readonly #splatBytes: number;
  #models = 0;
  #scratch = 0;

  constructor(
    readonly tiles: Tiles,
    readonly output: Output,
  ) {
    this.#splatBytes = splatBytes(output, tiles.front.header.sh_degree);
  }

  /** Bytes that decoders hold whatever tiles they have: models, and room to work in. */
  get fixed(): number {
    return this.#models + this.#scratch;
  }

  addModels(bytes: number): void {
    this.#models += Math.max(bytes, 0);
  }

  /** Learns from what all decoders hold with these many anchors in them: the rest is room to work in. */
  observe(memory: number, anchors: number): void {
    this.#scratch = Math.max(this.#scratch, memory - this.#models - anchors * ANCHOR_BYTES);
  }

  /** What is delivered as words takes places in runs. */
  splats(tile: number, layer: number): number {
    const splats = this.tiles.splats(tile, layer);
    return this.output === "words" ? inRuns(splats) : splats;
  }

  bytes(tile: number, layer: number): number {
    const { layers, slots } = this.tiles.index;
    const anchors = this.tiles.splats(tile, layer) / slots;
    const kept = layer < layers || this.tiles.keepsComplete ? anchors * ANCHOR_BYTES : 0;
    return this.splats(tile, layer) * this.#splatBytes + kept;
  }
}

/** What a tile costs in memory, learnt from what decoders report. */

import type { Output } from "../decoder/protocol.js";
import { inRuns, placeBytes } from "../pack/places.js";
import type { Cost } from "./budget.js";
import type { Tiles } from "./tiles.js";

const FLOAT = 4;
/** Bytes of an anchor in a decoder, before they were measured. */
const FIRST_GUESS = 256;
const LEAST = 16;
/** Reports that are learnt from. */
const KEPT = 16;
/** Anchors by which reports must differ for what one takes to be seen from them. */
const LEAST_SPREAD = 100;

interface Report {
  anchors: number;
  bytes: number;
}

/** Bytes of one delivered Gaussian. */
function splatBytes(output: Output, degree: number): number {
  if (output === "values") return FLOAT * (3 + 3 + 4 + 1 + 3 * (degree + 1) ** 2);
  return placeBytes(degree);
}

export class MemoryModel implements Cost {
  readonly #splatBytes: number;
  #anchorBytes = FIRST_GUESS;
  readonly #reports: Report[] = [];
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

  /** Bytes of an anchor in a decoder. */
  get anchorBytes(): number {
    return this.#anchorBytes;
  }

  addModels(bytes: number): void {
    this.#models += Math.max(bytes, 0);
  }

  /** Learns from what all decoders hold with these many anchors in them: a straight line through the last reports. */
  observe(memory: number, anchors: number): void {
    const reports = this.#reports;
    reports.push({ anchors, bytes: memory - this.#models });
    if (reports.length > KEPT) reports.shift();
    const mean = (of: (report: Report) => number) => reports.reduce((sum, one) => sum + of(one), 0) / reports.length;
    const a = mean((one) => one.anchors);
    const b = mean((one) => one.bytes);
    const spread = mean((one) => (one.anchors - a) ** 2);
    if (spread > LEAST_SPREAD ** 2) {
      this.#anchorBytes = Math.max(mean((one) => (one.anchors - a) * (one.bytes - b)) / spread, LEAST);
    }
    this.#scratch = Math.max(0, ...reports.map((one) => one.bytes - one.anchors * this.#anchorBytes));
  }

  /** What is delivered as words takes places in runs. */
  splats(tile: number, layer: number): number {
    const splats = this.tiles.splats(tile, layer);
    return this.output === "words" ? inRuns(splats) : splats;
  }

  bytes(tile: number, layer: number): number {
    const { layers, slots } = this.tiles.index;
    const anchors = this.tiles.splats(tile, layer) / slots;
    const kept = layer < layers || this.tiles.keepsComplete ? anchors * this.#anchorBytes : 0;
    return this.splats(tile, layer) * this.#splatBytes + kept;
  }
}

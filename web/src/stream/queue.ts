/** Tiles for which decoders have something to do, in the order of the plan. */

import type { Step } from "../plan/types.js";
import { compare } from "./budget.js";

export class Queue {
  readonly #tiles = new Set<number>();
  /** (tiles, layers): place of each step in the plan from nothing; Infinity where it has none. */
  readonly #places: Float64Array;

  constructor(
    tiles: number,
    readonly layers: number,
  ) {
    this.#places = new Float64Array(tiles * layers);
  }

  get size(): number {
    return this.#tiles.size;
  }

  add(tile: number): void {
    this.#tiles.add(tile);
  }

  delete(tile: number): void {
    this.#tiles.delete(tile);
  }

  /** @param ideal steps from nothing, in the order of their use */
  setPlan(ideal: Step[]): void {
    this.#places.fill(Infinity);
    ideal.forEach(({ tile, layer }, i) => (this.#places[tile * this.layers + layer - 1] = i));
  }

  /** Tiles by the place of their next layer. @param decoded (tiles) layers that decoders have */
  inOrder(decoded: Uint8Array): number[] {
    const next = (tile: number) => this.#place(tile, decoded[tile] + 1);
    return [...this.#tiles].sort((a, b) => compare(next(a), next(b)));
  }

  /**
   * The layer to which a tile is taken before another tile has its turn.
   * @param decoded (tiles) layers that decoders have
   */
  turnEnd(tile: number, decoded: Uint8Array): number {
    let others = Infinity;
    for (const one of this.#tiles) if (one !== tile) others = Math.min(others, this.#place(one, decoded[one] + 1));
    let layer = decoded[tile] + 1;
    while (layer < this.layers && this.#place(tile, layer + 1) <= others) layer++;
    return layer;
  }

  #place(tile: number, layer: number): number {
    return layer > this.layers ? Infinity : this.#places[tile * this.layers + layer - 1];
  }
}

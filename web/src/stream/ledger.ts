/** What each tile takes of the budgets, and will take on its way. */

import type { Cost } from "./budget.js";

/**
 * A tile that is taken further is charged at once for the most it will take until it has reached its goal. Decoders keep
 * more for a tile that is not complete than for one that is, so tiles that all began could else stop each other half way.
 */
export class Ledger {
  /** Totals of all tiles. */
  bytes = 0;
  splats = 0;
  readonly #bytes: Float64Array;
  readonly #splats: Float64Array;

  constructor(
    tiles: number,
    readonly cost: Cost,
  ) {
    this.#bytes = new Float64Array(tiles);
    this.#splats = new Float64Array(tiles);
  }

  /** What would be charged in addition for a tile, now after layer `now`, on its way to layer `goal`. */
  growth(tile: number, now: number, goal: number): { bytes: number; splats: number } {
    const { bytes, splats } = this.#price(tile, now, goal);
    return { bytes: bytes - this.#bytes[tile], splats: splats - this.#splats[tile] };
  }

  /** Charges a tile that is after layer `now`, on its way to layer `goal`: `now` itself where it stays there. */
  charge(tile: number, now: number, goal: number): void {
    const { bytes, splats } = this.growth(tile, now, goal);
    this.#bytes[tile] += bytes;
    this.#splats[tile] += splats;
    this.bytes += bytes;
    this.splats += splats;
  }

  /** Whether a tile is charged for more than it takes after layer `now`. */
  isOnItsWay(tile: number, now: number): boolean {
    return this.#splats[tile] > this.cost.splats(tile, now) || this.#bytes[tile] > this.cost.bytes(tile, now);
  }

  #price(tile: number, now: number, goal: number): { bytes: number; splats: number } {
    let bytes = 0;
    for (let k = now; k <= Math.max(goal, now); k++) bytes = Math.max(bytes, this.cost.bytes(tile, k));
    return { bytes, splats: this.cost.splats(tile, Math.max(goal, now)) };
  }
}

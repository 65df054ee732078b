/** What fits: how far each tile may be refined within the budgets, and which tiles go first when they do not. */

import type { Budgets, Step } from "../plan/types.js";

/** Cost of a tile after a layer, in all. */
export interface Cost {
  splats(tile: number, layer: number): number;
  /** What was delivered of it, and what the decoder keeps to go on. */
  bytes(tile: number, layer: number): number;
}

/**
 * Layers that each tile may have: the plan from nothing, followed to the first step that does not fit. (To go on past
 * it with smaller ones would make tiles come and go as the camera moves.)
 * @param ideal steps from nothing, in the order of their use
 */
export function goals(ideal: Step[], tiles: number, cost: Cost, budgets: Budgets): Uint8Array {
  const goal = new Uint8Array(tiles);
  let splats = 0;
  let bytes = 0;
  for (const { tile, layer } of ideal) {
    const before = goal[tile];
    const more = cost.splats(tile, layer) - cost.splats(tile, before);
    const larger = cost.bytes(tile, layer) - cost.bytes(tile, before);
    if (splats + more > budgets.splats || bytes + larger > budgets.bytes) break;
    goal[tile] = layer;
    splats += more;
    bytes += larger;
  }
  return goal;
}

/**
 * Tiles that may go, those of least use first: all that have more than their goal.
 * @param ideal steps from nothing, in the order of their use; tiles without a step are of no use
 * @param have (tiles) layers shown or decoded
 */
export function evictionOrder(ideal: Step[], have: Uint8Array, goal: Uint8Array): number[] {
  const place = new Float64Array(have.length).fill(Infinity);
  ideal.forEach(({ tile }, i) => (place[tile] = Math.min(place[tile], i)));
  const candidates = [...have.keys()].filter((tile) => have[tile] > goal[tile]);
  // Tiles that may show nothing go before those that only show too much.
  return candidates.sort((a, b) => Math.sign(goal[a]) - Math.sign(goal[b]) || compare(place[b], place[a]) || b - a);
}

/** The order of two numbers, infinite ones among them. */
export function compare(a: number, b: number): number {
  return a === b ? 0 : a < b ? -1 : 1;
}

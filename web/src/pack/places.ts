/** Places of Gaussians in textures: tiles take runs of them, and give them back, so that what fits a budget has room. */

import type { Budgets } from "../plan/types.js";
import type { Front } from "../format/directory.js";
import { GEOMETRY_TEXELS } from "./words.js";

/** Places that are taken together: a tile takes as few runs as hold it. */
export const RUN = 256;
const TEXEL_BYTES = 16;

/** Neighbouring places. */
export interface Span {
  first: number;
  count: number;
}

/** Places that so many Gaussians of a tile take. */
export function inRuns(count: number): number {
  return Math.ceil(count / RUN) * RUN;
}

/** Bytes of a place in textures of words. */
export function placeBytes(shDegree: number): number {
  return TEXEL_BYTES * (GEOMETRY_TEXELS + shDegree);
}

/** Places that hold all that a stream of words shows at once. @param budgets as the stream has them */
export function placesFor({ total, index, header }: Front, { splats = Infinity, bytes = Infinity }: Partial<Budgets>): number {
  const most = Math.min(splats, bytes / placeBytes(header.sh_degree));
  const all = inRuns(total) + RUN * index.tiles;
  return Math.max(Math.min(all, Math.floor(most / RUN) * RUN), RUN);
}

export class Places {
  /** First places of the runs of each tile. */
  readonly #runs = new Map<number, number[]>();
  /** First places of runs that were given back. */
  readonly #free: number[] = [];
  #next = 0;

  /** @param total a multiple of RUN */
  constructor(readonly total: number) {}

  /**
   * Places for a tile, those that it has first. Throws RangeError where there are no more.
   * @returns spans in the order of the Gaussians
   */
  take(tile: number, count: number): Span[] {
    const runs = this.#runs.get(tile) ?? [];
    this.#runs.set(tile, runs);
    while (runs.length * RUN < count) runs.push(this.#take());
    return spans(runs, count);
  }

  /** Takes the places of a tile back. @returns those that it had */
  give(tile: number): Span[] {
    const runs = this.#runs.get(tile) ?? [];
    this.#runs.delete(tile);
    this.#free.push(...runs.toReversed());
    return spans(runs, runs.length * RUN);
  }

  #take(): number {
    const free = this.#free.pop();
    if (free !== undefined) return free;
    if (this.#next >= this.total) throw new RangeError(`more than ${this.total} places: textures are smaller than the budget`);
    this.#next += RUN;
    return this.#next - RUN;
  }
}

/** The first `count` places of runs. */
function spans(runs: number[], count: number): Span[] {
  const found: Span[] = [];
  let left = count;
  for (const first of runs) {
    if (left <= 0) break;
    const last = found.at(-1);
    const taken = Math.min(left, RUN);
    if (last !== undefined && last.first + last.count === first) last.count += taken;
    else found.push({ first, count: taken });
    left -= taken;
  }
  return found;
}

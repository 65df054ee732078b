/** The camera, and for which camera centre each tile was last made. */

import type { Point } from "../decoder/types.js";
import type { Camera } from "../plan/types.js";

/**
 * Share of the distance to a tile by which the camera may move before what depends on the view is made again. To a tile
 * that it is in the distance is a share of the tile's size: what it holds is not all at hand.
 */
const MOVED = 0.1;
const WITHIN = 0.1;

export class Views {
  readonly #madeFor = new Map<number, Point>();

  /** @param boxes (tiles, 6) */
  constructor(
    readonly boxes: Float64Array,
    public camera: Camera | null,
  ) {}

  /** Camera centre for a tile that is made now. */
  use(tile: number): Point | undefined {
    const eye = this.camera?.position;
    if (eye !== undefined) this.#madeFor.set(tile, [...eye]);
    return eye;
  }

  /** @param shown layers that the tile is shown after */
  isStale(tile: number, shown: number): boolean {
    const eye = this.camera?.position;
    if (shown === 0 || eye === undefined) return false;
    const before = this.#madeFor.get(tile);
    if (before === undefined) return true;
    const box = this.boxes.subarray(6 * tile, 6 * tile + 6);
    const outside = Math.hypot(...eye.map((x, i) => Math.max(box[i] - x, x - box[3 + i], 0)));
    const within = WITHIN * Math.hypot(...eye.map((_, i) => box[3 + i] - box[i]));
    return Math.hypot(...eye.map((x, i) => x - before[i])) > MOVED * Math.max(outside, within);
  }
}

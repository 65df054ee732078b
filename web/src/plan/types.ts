/** What a planner is asked: which tile to refine next, for a camera. */

import type { Streaming } from "../format/streaming.js";

/** A camera in world coordinates. */
export interface Camera {
  position: [number, number, number];
  /** Unit vector along the line of sight. */
  forward: [number, number, number];
  /** Unit vector. */
  up: [number, number, number];
  /** Vertical field of view, radians. */
  fovY: number;
  /** Viewport, pixels. */
  width: number;
  height: number;
  /** World lengths a second. */
  velocity?: [number, number, number];
}

/** A tile to be taken from layer - 1 to layer. */
export interface Step {
  tile: number;
  /** From 1. */
  layer: number;
}

/** What a file says of its tiles before any data. Rows of tiles and layers lie tile by tile. */
export interface FileIndex {
  tiles: number;
  layers: number;
  /** Gaussians that an anchor stands for at most; 1 in the explicit profile. */
  slots: number;
  /** (tiles, 6): least and greatest corner of the tile's cube, world coordinates. */
  boxes: Float64Array;
  /** (tiles, layers): bytes of the TILE block, 0 where there is none. */
  bytes: Float64Array;
  /** (tiles, layers): anchors that first appear. */
  counts: Uint32Array;
  /** The block STREAMING; null before it has come, or where there is none. */
  streaming: Streaming | null;
}

/** What may be kept at once. */
export interface Budgets {
  /** Gaussians. */
  splats: number;
  /** Bytes of memory: what was delivered and is still shown, the state of decoders, data under way. */
  bytes: number;
}

/** Decides the order. It has no state: the same question has the same answer. */
export interface Planner {
  /**
   * @param camera null before the first view is set
   * @param have (tiles) layers that each tile has
   * @returns steps in the order to fetch; those of one tile by layer. Steps left out are not fetched
   */
  plan(index: FileIndex, camera: Camera | null, have: Uint8Array): Step[];
}

/** What a planner is asked: which tile to refine next, for a camera. */

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

/** What the front of a file says, in the terms of a planner. Rows of tiles and layers lie tile by tile. */
export interface SceneIndex {
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
  /** (layers): bytes of the blocks that a layer needs besides its tiles. */
  modelBytes: Float64Array;
}

/** What may be kept at once. */
export interface Budgets {
  /** Gaussians shown. */
  splats: number;
  /** Bytes of memory: what was delivered and is still shown, the state of decoders, data under way. */
  bytes: number;
}

/** Decides the order. It has no state: the same question has the same answer. */
export interface Planner {
  /** Kind of a block without tile that `plan` wants to see, if the file has one. */
  readonly annotation?: number;
  /**
   * @param annotation bytes of that block, null until they have arrived or where there is none
   * @param camera null before the first view is set
   * @param have (tiles) layers that each tile has
   * @returns steps in the order to fetch; those of one tile by layer. Steps left out are not fetched
   */
  plan(
    index: SceneIndex,
    annotation: Uint8Array | null,
    camera: Camera | null,
    have: Uint8Array,
    budgets: Budgets,
  ): Step[];
}

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

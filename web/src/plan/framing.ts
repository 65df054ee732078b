/** Where to look from before anyone has moved: the view that the file names, or one that shows its middle. */

import type { Front } from "../format/directory.js";
import type { Camera } from "./types.js";
import { add, cross, length, unit, upright } from "./vectors.js";

/** A place to look from. */
export interface View {
  position: [number, number, number];
  target: [number, number, number];
  up: [number, number, number];
  /** Field of view across the shorter side of the picture, radians: vertical in one that is wider than high. */
  fovY: number;
}

/** What is up in COLMAP's frames, where most scenes come from. */
const UPWARD = [0, -1, 0] as const;
const FRAME_RUB = 2;
const FIELD = (50 * Math.PI) / 180;
const ELEVATION = (20 * Math.PI) / 180;
/** As high as a camera can look down from that has a direction that is up. */
const STEEP = (85 * Math.PI) / 180;
/** Share of the Gaussians that the middle of a scene has, per axis: what is far away is sky and walls. */
const CORE = 0.8;

/** Where pictures begin: a length, or that share of the distance to what is looked at. */
const NEAR = { length: 0.2, share: 0.1 };

/** The view that a file begins with, as its block STREAMING has it (SPEC §7.13). */
export function viewOfFile(numbers: number[]): View {
  const [px, py, pz, tx, ty, tz, ux, uy, uz, fovY] = numbers;
  return { position: [px, py, pz], target: [tx, ty, tz], up: [ux, uy, uz], fovY };
}

/** Vertical field of view for a field across the shorter side: a picture higher than wide has it across. Radians. */
export function verticalField(field: number, width: number, height: number): number {
  return 2 * Math.atan(Math.tan(field / 2) / Math.min(width / Math.max(height, 1), 1));
}

/** A view as planners want it, for a picture of so many pixels, before there is anything that draws it. */
export function cameraOf({ position, target, up, fovY }: View, width: number, height: number): Camera {
  const forward = unit(add(target, position, -1));
  const upward = cross(upright(forward, up), forward);
  return { position: [...position], forward, up: upward, fovY: verticalField(fovY, width, height), width, height };
}

/** How far from the eye a picture begins, world lengths: where INRIA's renderer begins, nearer in small scenes. */
export function nearestDrawn({ position, target }: View): number {
  return Math.min(NEAR.length, NEAR.share * length(add(target, position, -1)));
}

/**
 * A view from outside onto the middle of the scene.
 * @param azimuth, elevation of the eye, radians
 */
export function outsideView({ header, index }: Front, azimuth = 0, elevation = ELEVATION): View {
  const up = UPWARD.map((x) => (header.coordinate_frame === FRAME_RUB ? -x : x)) as View["up"];
  const counts = Float64Array.from({ length: index.tiles }, (_, tile) => {
    return index.counts.subarray(tile * index.layers, (tile + 1) * index.layers).reduce((a, b) => a + b, 0);
  });
  const spans = [0, 1, 2].map((axis) => core(index.boxes, counts, axis));
  const target = spans.map(([low, high]) => (low + high) / 2) as View["target"];
  const extent = Math.hypot(...spans.map(([low, high]) => (high - low) / 2)) || 1;
  const distance = extent / Math.sin(FIELD / 2);
  // Level direction towards the eye: against z, which is forward in RDF and backward in RUB.
  const back = up[1] > 0 ? 1 : -1;
  const level = [Math.sin(azimuth), 0, back * Math.cos(azimuth)];
  const away = level.map((x, i) => x * Math.cos(elevation) + up[i] * Math.sin(elevation));
  const position = target.map((x, i) => x + distance * away[i]) as View["position"];
  return { position, target, up, fovY: FIELD };
}

/** Views from all sides, by name. */
export function sideViews(front: Front): Record<string, View> {
  const side = (quarters: number) => outsideView(front, (quarters * Math.PI) / 2);
  return { front: side(0), right: side(1), back: side(2), left: side(3), above: outsideView(front, 0, STEEP) };
}

/** Ends of the middle of the tiles' centres along an axis, each tile weighing as many Gaussians as it has. */
function core(boxes: Float64Array, counts: Float64Array, axis: number): [number, number] {
  const tiles = [...counts.keys()].map((t) => ({
    middle: (boxes[6 * t + axis] + boxes[6 * t + 3 + axis]) / 2,
    half: (boxes[6 * t + 3 + axis] - boxes[6 * t + axis]) / 2,
    count: counts[t],
  }));
  tiles.sort((a, b) => a.middle - b.middle);
  const total = tiles.reduce((sum, { count }) => sum + count, 0);
  const at = (share: number) => {
    let before = 0;
    for (const tile of tiles) {
      before += tile.count;
      if (before >= share * total && tile.count > 0) return tile;
    }
    return tiles[tiles.length - 1] ?? { middle: 0, half: 1, count: 0 };
  };
  const [low, high] = [at((1 - CORE) / 2), at((1 + CORE) / 2)];
  return low === high ? [low.middle - low.half, low.middle + low.half] : [low.middle, high.middle];
}

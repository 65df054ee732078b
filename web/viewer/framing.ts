/** Where to look from before anyone has moved: the view that the file names, or one that shows its middle. */

import type { Front } from "../src/format/directory.js";
import type { Streaming } from "../src/format/streaming.js";
import type { Camera } from "../src/plan/types.js";

export interface Frame {
  position: [number, number, number];
  target: [number, number, number];
  up: [number, number, number];
  /** Vertical field of view, radians. */
  fovY: number;
}

/** Directions that may be up; the first is that of COLMAP's frames, where most scenes come from. */
export const UPWARD: readonly [number, number, number][] = [
  [0, -1, 0],
  [0, 1, 0],
  [0, 0, 1],
  [0, 0, -1],
  [1, 0, 0],
  [-1, 0, 0],
];
const FRAME_RUB = 2;
const FIELD = (50 * Math.PI) / 180;
const ELEVATION = (20 * Math.PI) / 180;
/** Share of the Gaussians that the middle of a scene has, per axis: what is far away is sky and walls. */
const CORE = 0.8;

const NUMBERS = 10;

/** The view that the part of an address behind # names, null if none: position, target, up, degrees of field. */
export function namedView(hash: string): Frame | null {
  const said = new URLSearchParams(hash.replace(/^#/, "")).get("view");
  const numbers = (said ?? "").split(",").map((text) => (text.trim() === "" ? NaN : Number(text)));
  if (numbers.length !== NUMBERS || !numbers.every(Number.isFinite)) return null;
  const [px, py, pz, tx, ty, tz, ux, uy, uz, field] = numbers;
  if (!(field > 0 && field < 180) || Math.hypot(ux, uy, uz) === 0) return null;
  return { position: [px, py, pz], target: [tx, ty, tz], up: [ux, uy, uz], fovY: (field * Math.PI) / 180 };
}

/** The opposite, short enough for a message and exact enough for a picture. */
export function viewName({ position, target, up, fovY }: Frame): string {
  const numbers = [...position, ...target, ...up, (fovY * 180) / Math.PI];
  return `#view=${numbers.map((x) => Number(x.toPrecision(7))).join(",")}`;
}

/** The view that a STREAMING block names (SPEC §7.13), null if none. */
export function viewOfFile(streaming: Streaming): Frame | null {
  if (streaming.view === null) return null;
  const [px, py, pz, tx, ty, tz, ux, uy, uz, fovY] = streaming.view;
  return { position: [px, py, pz], target: [tx, ty, tz], up: [ux, uy, uz], fovY };
}

/** Vertical field of view for a field across the shorter side: a picture higher than wide has it across. Radians. */
export function verticalField(field: number, width: number, height: number): number {
  return 2 * Math.atan(Math.tan(field / 2) / Math.min(width / Math.max(height, 1), 1));
}

/** A view as planners want it, for a picture of so many pixels, before there is anything that draws it. */
export function cameraOf({ position, target, up, fovY }: Frame, width: number, height: number): Camera {
  const forward = unit([0, 1, 2].map((i) => target[i] - position[i]));
  const along = forward.reduce((sum, x, i) => sum + x * up[i], 0);
  const upright = unit(up.map((x, i) => x - along * forward[i]));
  return { position: [...position], forward, up: upright, fovY: verticalField(fovY, width, height), width, height };
}

function unit(vector: number[]): [number, number, number] {
  const length = Math.hypot(...vector) || 1;
  return vector.map((x) => x / length) as [number, number, number];
}

/** A view from outside onto the middle of the scene. */
export function outsideView({ header, index }: Front): Frame {
  const up = UPWARD[header.coordinate_frame === FRAME_RUB ? 1 : 0];
  const counts = Float64Array.from({ length: index.tiles }, (_, tile) => {
    return index.counts.subarray(tile * index.layers, (tile + 1) * index.layers).reduce((a, b) => a + b, 0);
  });
  const spans = [0, 1, 2].map((axis) => core(index.boxes, counts, axis));
  const target = spans.map(([low, high]) => (low + high) / 2) as Frame["target"];
  const extent = Math.hypot(...spans.map(([low, high]) => (high - low) / 2)) || 1;
  const distance = extent / Math.sin(FIELD / 2);
  // Level direction towards the eye: against z, which is forward in RDF and backward in RUB.
  const back = up[1] > 0 ? 1 : -1;
  const level = [0, 0, back * Math.cos(ELEVATION)];
  const position = target.map((x, i) => x + distance * (level[i] + up[i] * Math.sin(ELEVATION))) as Frame["position"];
  return { position, target, up: [...up], fovY: FIELD };
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

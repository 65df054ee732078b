/** The view that is planned for. */

import type { Point } from "../decoder/types.js";
import type { Boxes } from "./boxes.js";
import type { Camera } from "./types.js";
import { cross, dot, unit } from "./vectors.js";

/** How far ahead a moving camera is planned for. */
const AHEAD_SECONDS = 0.5;
/** How much wider than the picture is planned for: cameras turn. */
const MARGIN = 1.1;
/** Places along each side of a box, in halves of it, that stand for what is in it. */
const GRID = [-0.75, -0.25, 0.25, 0.75];
const PLACES = GRID.flatMap((a) => GRID.flatMap((b) => GRID.map((c): Point => [a, b, c])));
/** Of a distance, more than its rounding. */
const NEARLY = 1e-9;

/** Where the eye will be. */
export function soon({ position, velocity }: Camera): Point {
  if (velocity === undefined) return position;
  const at = (axis: number) => position[axis] + AHEAD_SECONDS * velocity[axis];
  return [at(0), at(1), at(2)];
}

/**
 * (n) which part of each box is in the picture, of 64 places in it that are looked at.
 * @param camera to look with, from where it will be
 */
export function shareInPicture({ middle, half }: Boxes, camera: Camera): Float64Array {
  const forward = unit(camera.forward);
  const right = unit(cross(forward, camera.up));
  const up = cross(right, forward);
  const tall = MARGIN * Math.tan(camera.fovY / 2);
  const wide = tall * (camera.width / camera.height);
  const eye = soon(camera);
  const picture = { forward, right, up, wide, tall };
  const seen = new Float64Array(half.length / 3);
  for (let tile = 0; tile < seen.length; tile++) {
    const at = 3 * tile;
    const away: Point = [middle[at] - eye[0], middle[at + 1] - eye[1], middle[at + 2] - eye[2]];
    const size: Point = [half[at], half[at + 1], half[at + 2]];
    seen[tile] = wholly(picture, away, size) ?? placesSeen(picture, away, size) / PLACES.length;
  }
  return seen;
}

interface Picture {
  forward: Point;
  right: Point;
  up: Point;
  /** Half the width and height of the picture at distance 1. */
  wide: number;
  tall: number;
}

/** Places of a box that are in the picture, from its middle, away from the eye, and half its sides. */
function placesSeen({ forward, right, up, wide, tall }: Picture, away: Point, size: Point): number {
  let seen = 0;
  for (const place of PLACES) {
    const x = away[0] + place[0] * size[0];
    const y = away[1] + place[1] * size[1];
    const z = away[2] + place[2] * size[2];
    const deep = x * forward[0] + y * forward[1] + z * forward[2];
    if (!(deep > 0 && Math.abs(x * right[0] + y * right[1] + z * right[2]) <= wide * deep)) continue;
    if (Math.abs(x * up[0] + y * up[1] + z * up[2]) <= tall * deep) seen++;
  }
  return seen;
}

/** 1 or 0 where a ball around all places is in the picture or beside it, null where that does not tell. */
function wholly({ forward, right, up, wide, tall }: Picture, away: Point, size: Point): number | null {
  const deep = dot(away, forward);
  const across = Math.abs(dot(away, right)) - wide * deep;
  const above = Math.abs(dot(away, up)) - tall * deep;
  // Rounding may not decide.
  const radius = Math.sqrt(dot(size, size)) + NEARLY * Math.sqrt(dot(away, away));
  const [aside, over] = [radius * Math.sqrt(1 + wide * wide), radius * Math.sqrt(1 + tall * tall)];
  if (deep < -radius || across > aside || above > over) return 0;
  return deep > radius && across < -aside && above < -over ? 1 : null;
}

/** The view that is planned for. Twin of scarfmt/streaming/view.py: the same answers. */

import type { Point } from "../decoder/types.js";
import { difference, type Boxes } from "./boxes.js";
import type { Camera } from "./types.js";

/** How far ahead a moving camera is planned for. */
const AHEAD_SECONDS = 0.5;
/** How much wider than the picture is planned for: cameras turn. */
const MARGIN = 1.1;
/** Places along each side of a box, in halves of it, that stand for what is in it. */
const GRID = [-0.75, -0.25, 0.25, 0.75];
const PLACES = GRID.flatMap((a) => GRID.flatMap((b) => GRID.map((c): Point => [a, b, c])));
/** Of the continued fraction of the tangent. */
const TERMS = 25;

/** Where the eye will be. */
export function soon({ position, velocity }: Camera): Point {
  if (velocity === undefined) return position;
  const at = (axis: number) => position[axis] + AHEAD_SECONDS * velocity[axis];
  return [at(0), at(1), at(2)];
}

/** The tangent of an angle of 0 to below a right angle, by divisions alone: libraries round it differently. */
export function tangent(angle: number): number {
  const squared = angle * angle;
  let below = 2 * TERMS + 1;
  for (let term = TERMS; term > 0; term--) below = 2 * term - 1 - squared / below;
  return angle / below;
}

/**
 * (n) which part of each box is in the picture, of 64 places in it that are looked at.
 * @param camera to look with, from where it will be
 */
export function shareInPicture({ middle, half }: Boxes, camera: Camera): Float64Array {
  const forward = unit(camera.forward);
  const right = unit(cross(forward, camera.up));
  const up = cross(right, forward);
  const tall = MARGIN * tangent(camera.fovY / 2);
  const wide = tall * (camera.width / camera.height);
  const eye = soon(camera);
  const seen = new Float64Array(half.length / 3);
  for (let tile = 0; tile < seen.length; tile++) {
    const at = 3 * tile;
    const away = difference(middle.subarray(at, at + 3), eye);
    for (const place of PLACES) {
      const p: Point = [
        away[0] + place[0] * half[at],
        away[1] + place[1] * half[at + 1],
        away[2] + place[2] * half[at + 2],
      ];
      const deep = along(p, forward);
      if (deep > 0 && Math.abs(along(p, right)) <= wide * deep && Math.abs(along(p, up)) <= tall * deep) seen[tile]++;
    }
  }
  return seen.map((count) => count / PLACES.length);
}

function along(a: Point, b: Point): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function unit([x, y, z]: Point): Point {
  const length = Math.sqrt(x * x + y * y + z * z);
  return [x / length, y / length, z / length];
}

function cross([ax, ay, az]: Point, [bx, by, bz]: Point): Point {
  return [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
}

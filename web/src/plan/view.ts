/** The view that is planned for. Twin of scarfmt/streaming/view.py: the same answers. */

import type { Point } from "../decoder/types.js";
import { difference, type Boxes } from "./boxes.js";
import type { Camera } from "./types.js";

/** How far ahead a moving camera is planned for. */
const AHEAD_SECONDS = 0.5;
/** How much wider than the picture is planned for: cameras turn. */
const MARGIN = 1.1;
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

/** Whether some of each box may be in the picture, a margin about it included: none of its sides keeps it out. */
export function inPicture({ middle, half }: Boxes, camera: Camera): boolean[] {
  const forward = unit(camera.forward);
  const right = unit(cross(forward, camera.up));
  const up = cross(right, forward);
  const tall = MARGIN * tangent(camera.fovY / 2);
  const wide = tall * (camera.width / camera.height);
  const side = (s: Point, sign: number, slope: number): Point => [
    sign * s[0] + slope * forward[0],
    sign * s[1] + slope * forward[1],
    sign * s[2] + slope * forward[2],
  ];
  const sides = [forward, side(right, 1, wide), side(right, -1, wide), side(up, 1, tall), side(up, -1, tall)];
  const eye = soon(camera);
  return Array.from({ length: half.length / 3 }, (_, tile) => {
    const h = half.subarray(3 * tile, 3 * tile + 3);
    const away = difference(middle.subarray(3 * tile, 3 * tile + 3), eye);
    return sides.every((s) => {
      const most = away[0] * s[0] + away[1] * s[1] + away[2] * s[2];
      return most + (h[0] * Math.abs(s[0]) + h[1] * Math.abs(s[1]) + h[2] * Math.abs(s[2])) >= 0;
    });
  });
}

function unit([x, y, z]: Point): Point {
  const length = Math.sqrt(x * x + y * y + z * z);
  return [x / length, y / length, z / length];
}

function cross([ax, ay, az]: Point, [bx, by, bz]: Point): Point {
  return [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
}

/** Where a file is placed in a scene (R-17-6, R-17-11): p in its coordinates is at s R p + t in those of the scene. */

import type { Point } from "../decoder/types.js";
import type { Camera } from "../plan/types.js";

export interface Placement {
  scale: number;
  /** (9) by rows. */
  rotation: Float64Array;
  translation: Point;
}

const LARGEST = 2 ** 60;
const TOLERANCE = 1e-4;
const AXES = [0, 1, 2] as const;

/** @param rows 4 x 4 @returns null where they are not of that kind (R-17-6) */
export function parsePlacement(rows: number[][]): Placement | null {
  const [a, b, c, last] = rows;
  const [x, y, z] = [a, b, c].map((row) => row.slice(0, 3));
  if (!rows.flat().every((value) => Math.abs(value) < LARGEST) || !last.every((value, i) => value === (i === 3 ? 1 : 0))) {
    return null;
  }
  const determinant = dot(x, cross(y, z));
  const scale = Math.cbrt(determinant);
  if (!(scale >= 1 / LARGEST && scale <= LARGEST)) return null;
  const rotation = Float64Array.from([...x, ...y, ...z], (value) => value / scale);
  const columns = AXES.map((i) => AXES.map((k) => rotation[3 * k + i]));
  const isRotation = AXES.every((i) => AXES.every((k) => Math.abs(dot(columns[i], columns[k]) - (i === k ? 1 : 0)) <= TOLERANCE));
  return isRotation ? { scale, rotation, translation: [a[3], b[3], c[3]] } : null;
}

/** R d */
export function turned({ rotation }: Placement, [x, y, z]: Point): Point {
  const along = (i: number) => rotation[3 * i] * x + rotation[3 * i + 1] * y + rotation[3 * i + 2] * z;
  return [along(0), along(1), along(2)];
}

/** R^T d */
function turnedBack({ rotation }: Placement, [x, y, z]: Point): Point {
  const along = (i: number) => rotation[i] * x + rotation[3 + i] * y + rotation[6 + i] * z;
  return [along(0), along(1), along(2)];
}

/** A camera of the scene in the coordinates of a file: what it sees there is what it saw. */
export function cameraIn(placement: Placement | null, camera: Camera): Camera {
  if (placement === null) return camera;
  const { scale, translation } = placement;
  const length = ([x, y, z]: Point): Point => [x / scale, y / scale, z / scale];
  const [x, y, z] = camera.position;
  const [tx, ty, tz] = translation;
  const { velocity } = camera;
  return {
    ...camera,
    position: length(turnedBack(placement, [x - tx, y - ty, z - tz])),
    forward: turnedBack(placement, camera.forward),
    up: turnedBack(placement, camera.up),
    ...(velocity === undefined ? {} : { velocity: length(turnedBack(placement, velocity)) }),
  };
}

/** The box (6) along the axes of the scene that a box (6) of a file is in. */
export function placedBox(placement: Placement | null, box: Float64Array): Float64Array {
  if (placement === null) return box;
  const { scale, rotation, translation } = placement;
  const out = new Float64Array(6);
  for (const i of AXES) {
    let middle = translation[i];
    let half = 0;
    for (const k of AXES) {
      middle += (scale * rotation[3 * i + k] * (box[k] + box[3 + k])) / 2;
      half += (scale * Math.abs(rotation[3 * i + k]) * (box[3 + k] - box[k])) / 2;
    }
    out[i] = middle - half;
    out[3 + i] = middle + half;
  }
  return out;
}

function dot(a: ArrayLike<number>, b: ArrayLike<number>): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function cross([ax, ay, az]: number[], [bx, by, bz]: number[]): number[] {
  return [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
}

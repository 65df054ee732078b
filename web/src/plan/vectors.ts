/** Vectors of three numbers. */

import type { Point } from "../decoder/types.js";

export function dot(a: Point, b: Point): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

export function cross([ax, ay, az]: Point, [bx, by, bz]: Point): Point {
  return [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
}

export function length(vector: Point): number {
  return Math.sqrt(dot(vector, vector));
}

/** The unit vector of the same direction; zero of zero. */
export function unit([x, y, z]: Point): Point {
  const size = length([x, y, z]) || 1;
  return [x / size, y / size, z / size];
}

/** A unit vector that is upright on two, as a right hand has it; on one of them where they lie along one line. */
export function upright(a: Point, b: Point): Point {
  const found = [b, [1, 0, 0] as Point, [0, 1, 0] as Point].map((other) => unit(cross(a, other))).find((one) => length(one) > 0.5);
  return found ?? [0, 0, 1];
}

/** a + scale b */
export function add(a: Point, b: Point, scale = 1): Point {
  return [a[0] + scale * b[0], a[1] + scale * b[1], a[2] + scale * b[2]];
}

/** A vector turned round a unit vector, radians, as a right hand does. */
export function turn(vector: Point, axis: Point, angle: number): Point {
  const [cosine, sine] = [Math.cos(angle), Math.sin(angle)];
  const across = add([0, 0, 0], vector, cosine);
  return add(add(across, cross(axis, vector), sine), axis, dot(axis, vector) * (1 - cosine));
}

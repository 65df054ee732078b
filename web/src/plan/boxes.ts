/** Where tiles are, and how large they look. */

import type { Streaming } from "../format/streaming.js";

/** The solid angle of everything. */
const ALL_ROUND = 4 * Math.PI;
/** Steps of a reach in an octave (SPEC §7.13). */
const STEPS = 4;
/** The reach that is as long as the side of its tile (SPEC §7.13). */
const REACH_OF_SIDE = 128;
/** How far splats count as sticking out of a tight box, of what the file says: where they are faint they show little. */
const SHOWN_OF_REACH = 0.5;

/** Boxes of n tiles, world units. */
export interface Boxes {
  /** (n, 3) */
  middle: Float64Array;
  /** (n, 3) half their sides. */
  half: Float64Array;
}

/**
 * What a file says of where the content of its tiles shows; the cubes where it says nothing.
 * @param cubes (n, 6) lowest and highest corners
 */
export function tightBoxes(cubes: Float64Array, streaming: Streaming | null): Boxes {
  const tiles = cubes.length / 6;
  const boxes = { middle: new Float64Array(3 * tiles), half: new Float64Array(3 * tiles) };
  for (let tile = 0; tile < tiles; tile++) {
    const level = streaming === null ? 0 : streaming.reach[tile];
    const side = cubes[6 * tile + 3] - cubes[6 * tile];
    const out = level > 0 ? SHOWN_OF_REACH * (side * 2 ** ((level - REACH_OF_SIDE) / STEPS)) : 0;
    for (let axis = 0; axis < 3; axis++) {
      let low = cubes[6 * tile + axis];
      let high = cubes[6 * tile + 3 + axis];
      const at = 3 * tile + axis;
      if (streaming !== null) {
        const part = (high - low) / 256;
        high = low + part * (streaming.high[at] + 1) + out;
        low = low + part * streaming.low[at] - out;
      }
      boxes.middle[at] = (low + high) / 2;
      boxes.half[at] = (high - low) / 2;
    }
  }
  return boxes;
}

/** (n) solid angle that boxes take up, seen from `eye`; one that it is in, or next to, is all round. */
export function coverage({ middle, half }: Boxes, eye: ArrayLike<number>): Float64Array {
  const out = new Float64Array(half.length / 3);
  for (let tile = 0; tile < out.length; tile++) {
    const at = 3 * tile;
    const x = Math.abs(middle[at] - eye[0]);
    const y = Math.abs(middle[at + 1] - eye[1]);
    const z = Math.abs(middle[at + 2] - eye[2]);
    const squared = x * x + y * y + z * z;
    const distance = Math.sqrt(squared);
    const sides = x * half[at + 1] * half[at + 2] + y * half[at] * half[at + 2];
    const area = 4 * (sides + z * half[at] * half[at + 1]);
    const inside = x <= half[at] && y <= half[at + 1] && z <= half[at + 2];
    // Worlds as large as numbers go make infinities, and no number of two of them: such boxes count as near.
    const near = inside || !(area < ALL_ROUND * squared * distance);
    out[tile] = near ? ALL_ROUND : area / (squared * distance);
  }
  return out;
}

/** Cubes of tiles and of pages in the world (SPEC §6.2). */

import { MAX_DEPTH } from "./registry.js";

const AXES = 3;
/** Triples of a Morton code that are taken at once, so that numbers do. */
const TRIPLES = 7;
const CHUNK = BigInt(AXES * TRIPLES);
const MASK = (1n << CHUNK) - 1n;

/** A cube of the lattice, as its row of a tile page says. */
export interface Place {
  depth: number;
  prefix: bigint;
}

/** What of a header places cubes. */
interface Lattice {
  lattice_bits: number;
  origin: ArrayLike<number>;
  voxel: number;
}

/** Writes least and greatest corner of a cube (6), R-6.2-2. */
export function writeBox(box: Float64Array, { lattice_bits, origin, voxel }: Lattice, { depth, prefix }: Place): void {
  const side = 2 ** (lattice_bits - depth);
  const at = coordinates(prefix);
  for (let axis = 0; axis < AXES; axis++) {
    const corner = at[axis] * side;
    box[axis] = origin[axis] + voxel * corner;
    box[AXES + axis] = origin[axis] + voxel * (corner + side);
  }
}

/** The coordinates that a Morton code is made of. */
function coordinates(code: bigint): [number, number, number] {
  const out: [number, number, number] = [0, 0, 0];
  let scale = 1;
  for (let left = code; left > 0n; left >>= CHUNK) {
    const triples = Number(left & MASK);
    for (let bit = 0; bit < TRIPLES; bit++) {
      for (let axis = 0; axis < AXES; axis++) out[axis] += ((triples >> (AXES * bit + axis)) & 1) * scale * 2 ** bit;
    }
    scale *= 2 ** TRIPLES;
  }
  return out;
}

/** Writes the box (6) of all cubes from a Morton code at depth 21 on, up to another one. */
export function writeRangeBox(box: Float64Array, lattice: Lattice, from: bigint, past: bigint): void {
  box.fill(Infinity, 0, AXES).fill(-Infinity, AXES);
  const cube = new Float64Array(2 * AXES);
  for (let at = from; at < past; ) {
    let depth = MAX_DEPTH;
    let size = 1n;
    while (depth > 0 && at % (8n * size) === 0n && at + 8n * size <= past) {
      size *= 8n;
      depth--;
    }
    writeBox(cube, lattice, { depth, prefix: at / size });
    for (let axis = 0; axis < AXES; axis++) {
      box[axis] = Math.min(box[axis], cube[axis]);
      box[AXES + axis] = Math.max(box[AXES + axis], cube[AXES + axis]);
    }
    at += size;
  }
}

/** Header, tile table and directory (SPEC §5), which come before any data and say where everything is. */

import { BLOCK, DEFAULT_LIMITS, NO_TILE } from "../../../conformance/decoders/js/constants.js";
import { readContainer } from "../../../conformance/decoders/js/container.js";
import { directoryEnd, readHeader } from "../../../conformance/decoders/js/header.js";
import { SparseSource } from "../decoder/sparse.js";
import type { SceneIndex } from "../plan/types.js";

export type Container = ReturnType<typeof readContainer>;

const FILE_LENGTH_AT = 16;
const FILE_LENGTH_END = 24;
/** The longest header (SPEC §5.2). */
export const MOST_HEADER = 2280;

/** What is known of a scene before any of its data. */
export interface Front {
  header: Container["header"];
  /** Layers, with anchors, Gaussians and bytes after each. */
  layers: Container["layers"];
  index: SceneIndex;
  /**
   * (tiles): place of the first Gaussian of each tile in an array of the whole scene. A Gaussian's place never moves
   * while layers arrive (R-6.3-1).
   */
  base: Uint32Array;
  /** (tiles): Gaussians of each tile after the last layer; slots that stay off included. */
  finalCounts: Uint32Array;
  /** Gaussians of all tiles. */
  total: number;
}

/** The front with what only the stream looks at. */
export interface ParsedFront extends Front {
  entries: Container["entries"];
  /** (tiles, layers): entry of each TILE block, -1 where there is none. */
  tileEntries: Int32Array;
  /** Entries of the blocks that each layer needs besides its tiles, by layer - 1. */
  modelEntries: number[][];
  /** Bytes of the front. */
  length: number;
}

/** A source that holds the first bytes of a file, as long as its header says. */
function startOf(bytes: Uint8Array, size: number | null): SparseSource {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const declared = bytes.length < FILE_LENGTH_END ? bytes.length : Number(view.getBigUint64(FILE_LENGTH_AT, true));
  const source = new SparseSource(size ?? declared);
  source.put(0, bytes);
  return source;
}

/**
 * Bytes up to the end of the directory. Throws a refusal where the header breaks a rule.
 * @param bytes the first MOST_HEADER bytes, or the whole of a shorter file
 * @param size of the file, null where the server does not say
 */
export function frontLength(bytes: Uint8Array, size: number | null): number {
  return directoryEnd(readHeader(startOf(bytes, size), DEFAULT_LIMITS, false).header);
}

/** Throws a refusal where the front breaks a rule of §5. */
export function parseFront(bytes: Uint8Array, size: number | null): ParsedFront {
  const { header, layers, tiles, entries } = readContainer(startOf(bytes, size), DEFAULT_LIMITS, false);
  const n = header.tile_count;
  const k = header.layer_count;
  const index: SceneIndex = {
    tiles: n,
    layers: k,
    slots: header.slots,
    boxes: tileBoxes(header, tiles),
    bytes: new Float64Array(n * k),
    counts: new Uint32Array(n * k),
    modelBytes: new Float64Array(k),
  };
  const tileEntries = new Int32Array(n * k).fill(-1);
  const modelEntries: number[][] = Array.from({ length: k }, () => []);
  const finalCounts = new Uint32Array(n);
  for (let e = 0; e < entries.kind.length; e++) {
    const layer = entries.layer[e] - 1;
    if (entries.kind[e] === BLOCK.TILE) {
      const at = entries.tile[e] * k + layer;
      tileEntries[at] = e;
      index.bytes[at] = entries.length[e];
      index.counts[at] = entries.count[e];
      finalCounts[entries.tile[e]] += entries.count[e] * header.slots;
    } else if (entries.kind[e] < BLOCK.TILE) {
      modelEntries[layer].push(e);
      index.modelBytes[layer] += entries.length[e];
    }
  }
  const base = new Uint32Array(n);
  for (let t = 1; t < n; t++) base[t] = base[t - 1] + finalCounts[t - 1];
  const total = n === 0 ? 0 : base[n - 1] + finalCounts[n - 1];
  const length = directoryEnd(header);
  return { header, layers, index, base, finalCounts, total, entries, tileEntries, modelEntries, length };
}

/** The entry of a block of a kind that belongs to no tile, -1 where there is none. */
export function findAnnotation({ entries }: ParsedFront, kind: number): number {
  return entries.kind.findIndex((one, e) => one === kind && entries.tile[e] === NO_TILE);
}

/** World boxes of the tiles' cubes (tiles, 6), R-6.2-2. */
function tileBoxes({ lattice_bits, origin, voxel }: Container["header"], tiles: Container["tiles"]): Float64Array {
  const { depth, prefix } = tiles;
  const boxes = new Float64Array(6 * depth.length);
  for (let t = 0; t < depth.length; t++) {
    const side = 2 ** (lattice_bits - depth[t]);
    for (let axis = 0; axis < 3; axis++) {
      const corner = spread(prefix[t], depth[t], axis) * side;
      boxes[6 * t + axis] = origin[axis] + voxel * corner;
      boxes[6 * t + 3 + axis] = origin[axis] + voxel * (corner + side);
    }
  }
  return boxes;
}

/** The coordinate of one axis in a Morton code of `bits` triples. */
function spread(code: bigint, bits: number, axis: number): number {
  let value = 0;
  for (let bit = bits - 1; bit >= 0; bit--) value = 2 * value + Number((code >> BigInt(3 * bit + axis)) & 1n);
  return value;
}

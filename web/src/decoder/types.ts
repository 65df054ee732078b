/** What decoders take and give. */

/** A block that belongs to no tile; `body` is its bytes in the file, whose CRC the caller has checked. */
export interface Block {
  /** Block kind, SPEC §16.5. */
  kind: number;
  body: Uint8Array;
}

/** Where a tile is, as its tile page says (SPEC §5.5). */
export interface Cube {
  depth: number;
  shift: number;
  prefix: bigint;
}

/** The TILE block of a tile in a layer, whose CRC the caller has checked. */
export interface TileBlock {
  /** Layer, from 1. */
  layer: number;
  /** Anchors that appear. */
  count: number;
  /** Empty where the tile has no block, which refines it by empty sub-streams (R-7.1-6): pass it all the same. */
  body: Uint8Array;
}

/**
 * What a renderer needs of one tile after some layer.
 *
 * In the explicit profile, index i is anchor i of the tile, and keeps its index in all later layers (R-6.3-1). In the
 * anchor profile, index a * slots + s is slot s of anchor a, on or off, for one camera centre: `count` is then anchors
 * times slots, and a slot that is not drawn (R-9.6-1) has opacity 0. So an index never moves in either profile.
 */
export interface TileValues {
  tile: number;
  /** The last layer decoded. */
  layer: number;
  /** n, how many are present now. */
  count: number;
  /** (n, 3), world coordinates. */
  centres: Float32Array;
  /** (n, 3), standard deviations in world lengths. */
  scales: Float32Array;
  /** (n, 4), unit quaternions w, x, y, z. */
  quats: Float32Array;
  /** (n), 0..1. */
  opacity: Float32Array;
  /** (n, (shDegree + 1)², 3): by coefficient, then red, green, blue (§9.4). */
  sh: Float32Array;
  shDegree: number;
}

/** One tile in words of textures, as our adapters draw from them (pack/words.ts); indices are those of `TileValues`. */
export interface PackedTile {
  tile: number;
  layer: number;
  count: number;
  shDegree: number;
  /** (n, 8): centre, scales, rotation, colour, opacity. */
  geometry: Uint32Array;
  /** (n, 4 shDegree): spherical harmonics above degree 0. */
  harmonics: Uint32Array;
}

/** A point in world coordinates. */
export type Point = [number, number, number];

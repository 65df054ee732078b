/** What every decoder of tiles does, whether in JavaScript or WebAssembly. One instance serves one file. */

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

/** What a row page says of a tile in a layer, with the block that it tells of, whose CRC the caller has checked. */
export interface TileBlock {
  /** Layer, from 1. */
  layer: number;
  /** Of the block in the file. */
  offset: number;
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

/** Words of textures, as our adapters draw from them (pack/words.ts). */
export type PackTarget = "words";

/** One tile in words; indices are those of `TileValues`. */
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

/**
 * What is wrong with a file is thrown as an Error with `id` (a refusal of SPEC §12.1, such as "crc-mismatch") and
 * `offset` (byte of the file, or null). A tile that threw is forgotten, as after `release`; others are not touched.
 * Calls out of order (a layer skipped, a tile that is not there) throw RangeError.
 */
export interface Refusal extends Error {
  id: string;
  offset: number | null;
}

/** What decodes. */
export type Engine = "wasm" | "js";

export interface TileDecoder {
  readonly engine: Engine;
  /**
   * Reads header and ROOT, checked by §5.
   * @param front the first bytes of the file, up to the end of ROOT or beyond
   */
  open(front: Uint8Array): void;
  /**
   * Takes every block of a layer that belongs to no tile, in the order of the file; once a layer, layer by layer.
   * A decoder ignores kinds that it does not know.
   */
  addModels(layer: number, blocks: Block[]): void;
  /**
   * Takes a tile from block.layer - 1 to block.layer; its integers are kept. The models of the layer must be there.
   * @param cube of the tile: the same in every call
   */
  advance(tile: number, cube: Cube, block: TileBlock): void;
  /**
   * Values of a tile, in fresh arrays that may be transferred.
   * @param eye camera centre, which only the anchor profile looks at; the origin of the header without it
   */
  values(tile: number, eye?: Point): TileValues;
  /** The same in words. */
  packed(tile: number, target: PackTarget, eye?: Point): PackedTile;
  /** Forgets the integers of a tile. It may be advanced again from layer 1. */
  release(tile: number): void;
  /** Bytes held for tiles and models. */
  memory(): number;
}

export type MakeDecoder = () => Promise<TileDecoder>;

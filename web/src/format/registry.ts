/** Registries of SPEC §16.4 to §16.6, limits of §13. */

/** Block kinds, §16.5. */
export const BLOCK = { PREDICTORS: 8, THUMBNAIL: 15, TILE: 16, METADATA: 64, STREAMING: 65 } as const;

export const PROFILE = { EXPLICIT: 0, ANCHOR: 1 } as const;

export const MAX_LAYERS = 16;
/** Depth of the smallest tiles; Morton codes at this depth have 63 bits (SPEC §6.2). */
export const MAX_DEPTH = 21;

/** Limits of this reader: those of §13.2. */
export const LIMITS = {
  tiles: 1048576,
  root_bytes: 16777216,
  anchors: 2147483648,
  gaussians: 68719476736,
  anchors_per_byte: 1,
  slots_per_byte: 8,
  block_bytes: 268435456,
  tile_anchors: 65536,
} as const;

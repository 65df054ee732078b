/** Registries of SPEC §16, limits of §13. */

/** Block kinds, §16.5. */
export const BLOCK = Object.freeze({
  LAYER: 1,
  TABLES: 2,
  CODEBOOKS: 3,
  DECODER_MLP: 4,
  SCENE_MLP: 5,
  HASH_GRID: 6,
  ENTROPY_NETWORK: 7,
  PREDICTORS: 8,
  TILE: 16,
  METADATA: 64,
  STREAMING: 65,
});

/** Stream kinds, §16.6. */
export const STREAM = Object.freeze({
  MODELS: 0,
  POSITIONS: 1,
  CLASSES: 2,
  MASKS: 3,
  POSITION_RESIDUAL: 4,
  SCALE: 5,
  ROTATION: 6,
  OPACITY: 7,
  COLOUR: 8,
  INDICES: 9,
  LATENT: 10,
  OFFSETS: 11,
  FRAMING: 12,
});

/** Name of each stream kind. @type {readonly string[]} */
export const STREAM_NAMES = Object.freeze(Object.keys(STREAM));

export const PROFILE = Object.freeze({ EXPLICIT: 0, ANCHOR: 1 });

/** The `tile` of an entry that belongs to none, as the decoder protocol lists it. */
export const NO_TILE = 0xffffffff;

export const MAX_LAYERS = 16;
export const MAX_TILES = 16777216;
export const MAX_STAGES = 8;
export const MAX_STEPS = 20;
export const MAX_CLASSES = 15;
export const MAX_METADATA_DEPTH = 64;
export const MAX_VIEWPOINTS = 64;

/**
 * Limits of a reader, §13.2.
 * @typedef {{tiles: number, root_bytes: number, anchors: number, gaussians: number, anchors_per_byte: number,
 *   slots_per_byte: number, block_bytes: number, tile_anchors: number, gathered: number, gathered_slots: number,
 *   metadata_bytes: number}} Limits
 */

/** @type {Readonly<Limits>} */
export const DEFAULT_LIMITS = Object.freeze({
  tiles: 1048576,
  root_bytes: 16777216,
  anchors: 2147483648,
  gaussians: 68719476736,
  anchors_per_byte: 1,
  slots_per_byte: 8,
  block_bytes: 268435456,
  tile_anchors: 65536,
  gathered: 67108864,
  gathered_slots: 268435456,
  metadata_bytes: 1048576,
});

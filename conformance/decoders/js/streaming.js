/** STREAMING (SPEC §7.13): what tells a client which tiles and layers to fetch first. */

import { Reader } from "./bytes.js";
import { BLOCK, MAX_LAYERS, MAX_TILES, MAX_VIEWPOINTS } from "./constants.js";
import { blockBytes, checkBlock, findBlock } from "./container.js";

/** @typedef {import("./container.js").Container} Container */

/**
 * @typedef {object} Streaming
 * @property {number} layers that gains are told of
 * @property {number} tiles
 * @property {Float32Array | null} view position, target, up, vertical field in radians
 * @property {Float32Array} viewpoints (V * 3)
 * @property {Uint8Array} low (tiles * 3) corners of the tight boxes in 1/256 of the side of a tile
 * @property {Uint8Array} high (tiles * 3), within the box
 * @property {Uint8Array} reach (tiles)
 * @property {Uint8Array} gains (V * layers * tiles)
 */

const VIEW = 10;

/**
 * @param {Container} container
 * @returns {Streaming | null} null without the block
 */
export function readStreaming(container) {
  const e = findBlock(container, 1, BLOCK.STREAMING);
  if (e < 0) return null;
  checkBlock(container, e);
  const reader = new Reader(blockBytes(container, e), container.entries.offset[e]);
  const streaming = parseStreaming(reader);
  const { tile_count, layer_count } = container.header;
  reader.demand(streaming.tiles === tile_count, "bad-streaming", `${streaming.tiles} tiles of ${tile_count}`);
  reader.demand(streaming.layers >= layer_count, "bad-streaming", `${streaming.layers} layers of ${layer_count}`);
  return streaming;
}

/**
 * @param {Reader} reader of the block
 * @returns {Streaming}
 */
export function parseStreaming(reader) {
  const layers = reader.u8();
  reader.demand(layers >= 1 && layers <= MAX_LAYERS, "bad-streaming", `${layers} layers`);
  const tiles = reader.count(MAX_TILES);
  const view = floats(reader, reader.count(1) * VIEW);
  if (view.length > 0) {
    const field = view[VIEW - 1];
    reader.demand(view.every(Number.isFinite) && field > 0 && field < Math.PI, "bad-streaming", "no view");
  }
  const viewpointCount = reader.count(MAX_VIEWPOINTS);
  const viewpoints = floats(reader, 3 * viewpointCount);
  reader.demand(viewpoints.every(Number.isFinite), "bad-streaming", "a viewpoint is not finite");
  const low = reader.take(3 * tiles);
  const high = reader.take(3 * tiles);
  reader.demand(low.every((corner, i) => corner <= high[i]), "bad-streaming", "a box ends before it begins");
  const reach = reader.take(tiles);
  const gains = reader.take(viewpointCount * layers * tiles);
  reader.end();
  return { layers, tiles, view: view.length > 0 ? view : null, viewpoints, low, high, reach, gains };
}

/**
 * @param {Reader} reader
 * @param {number} count
 */
function floats(reader, count) {
  const numbers = new Float32Array(count);
  for (let i = 0; i < count; i++) numbers[i] = reader.f32();
  return numbers;
}

/** In which order to fetch layers of tiles, for a view. Twin of scarfmt/streaming/plan.py: the same steps. */

import { Reader } from "../../../conformance/decoders/js/bytes.js";
import { BLOCK } from "../../../conformance/decoders/js/constants.js";
import { parseStreaming, type Streaming } from "../../../conformance/decoders/js/streaming.js";
import { tightBoxes } from "./boxes.js";
import { inFileOrder } from "./file_order.js";
import { gainsFrom } from "./gains.js";
import type { Camera, Planner, SceneIndex, Step } from "./types.js";
import { shareInPicture, soon } from "./view.js";

/** Part of a tile that counts as in the picture where none is: a camera may turn, and splats stick out. */
const BEHIND = 0.02;
/** Bytes that a block costs beside its own: its part of requests, and time to decode. */
const OVERHEAD = 64;

/** Layers of a tile that go together: gain a byte, first layer, tile, last layer. */
interface Part {
  worth: number;
  low: number;
  tile: number;
  past: number;
}

/**
 * First layer 1 of every tile in the picture, so that there are no holes; then by what is gained a byte. A layer may
 * gain little and the one after it much: of the layers of a tile that are missing, as many go together as gain most a
 * byte. Equal gains go by layer, then tile. Without a camera the order is that of the file.
 */
export function planByView(
  index: SceneIndex,
  streaming: Streaming | null,
  camera: Camera | null,
  have: Uint8Array,
): Step[] {
  const { tiles, layers } = index;
  if (camera === null) return inFileOrder(index, have);
  const boxes = tightBoxes(index.boxes, streaming);
  const share = shareInPicture(boxes, camera);
  const most = have.reduce((a, b) => Math.max(a, b), 0);
  const costOf = (tile: number, layer: number) =>
    index.bytes[tile * layers + layer] + OVERHEAD + (layer + 1 > most ? index.modelBytes[layer] : 0) / tiles;
  const gains = gainsFrom(soon(camera), boxes, streaming, layers, costOf);
  const first: Part[] = [];
  const then: Part[] = [];
  for (let tile = 0; tile < tiles; tile++) {
    const gain = (layer: number) => gains[layer * tiles + tile] * Math.max(share[tile], BEHIND);
    const cost = (layer: number) => costOf(tile, layer);
    let start = have[tile];
    if (start === 0 && layers > 0 && share[tile] > 0) {
      first.push({ worth: gain(0) / cost(0), low: 1, tile, past: 1 });
      start = 1;
    }
    while (start < layers) {
      const part = bestPart(tile, start, layers, gain, cost);
      then.push(part);
      start = part.past;
    }
  }
  return steps(first.sort(order).concat(then.sort(order)));
}

/** The beginning of what is missing of a tile that gains most a byte, the shortest of equals. */
function bestPart(
  tile: number,
  start: number,
  layers: number,
  gainOf: (layer: number) => number,
  costOf: (layer: number) => number,
): Part {
  const best = { worth: -1, low: start + 1, tile, past: start };
  let gain = 0;
  let cost = 0;
  for (let layer = start; layer < layers; layer++) {
    gain = gain + gainOf(layer);
    cost = cost + costOf(layer);
    if (gain / cost > best.worth) {
      best.worth = gain / cost;
      best.past = layer + 1;
    }
  }
  return best;
}

function order(a: Part, b: Part): number {
  return b.worth - a.worth || a.low - b.low || a.tile - b.tile;
}

function steps(parts: Part[]): Step[] {
  const found: Step[] = [];
  for (const { tile, low, past } of parts) for (let layer = low; layer <= past; layer++) found.push({ tile, layer });
  return found;
}

/** What was read of a block: plans are made many times a second. */
const readBefore = new WeakMap<Uint8Array, Streaming | null>();

/**
 * What a STREAMING block says that fits the file; null where there is none, or one that cannot be meant: who streams
 * then goes by what tiles look like. A block is read once.
 */
export function readTold(block: Uint8Array | null, index: SceneIndex): Streaming | null {
  if (block === null) return null;
  const before = readBefore.get(block);
  if (before !== undefined) return before;
  const told = parsedTold(block, index);
  readBefore.set(block, told);
  return told;
}

function parsedTold(block: Uint8Array, { tiles, layers }: SceneIndex): Streaming | null {
  try {
    const told = parseStreaming(new Reader(block));
    return told.tiles === tiles && told.layers >= layers ? told : null;
  } catch {
    return null;
  }
}

/** Plans for the view, by what the file tells of its tiles. What does not fit the budgets, its caller leaves out. */
export const byView: Planner = {
  annotation: BLOCK.STREAMING,
  plan: (index, annotation, camera, have) => planByView(index, readTold(annotation, index), camera, have),
};

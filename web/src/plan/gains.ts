/** What a layer of a tile is worth, seen from anywhere. Twin of scarfmt/streaming/gains.py: the same numbers. */

import type { Streaming } from "../../../conformance/decoders/js/streaming.js";
import type { Point } from "../decoder/types.js";
import { coverage, difference, octaves, type Boxes } from "./boxes.js";

const GAIN_OF_ONE = 255;
/** Viewpoints that are looked at. */
const NEAREST = 3;
/** How much larger or smaller than from a viewpoint a tile counts at most. */
const MOST_RATIO = 4;
/** What a layer is worth of what the one before was, where nothing is told. */
const USUAL_FALL = 0.5;

const GAINS = octaves(-GAIN_OF_ONE - 1, GAIN_OF_ONE + 2).subarray(1);

/**
 * (layers, tiles): what each layer of each tile takes away of the squared error of a picture that has it in it.
 * @param layers of the file; the file may tell of more
 */
export function gainsFrom(eye: Point, boxes: Boxes, streaming: Streaming | null, layers: number): Float64Array {
  const size = coverage(boxes, eye);
  const tiles = size.length;
  const total = new Float64Array(layers * tiles);
  if (streaming === null || streaming.viewpoints.length === 0) {
    let worth = 1;
    for (let layer = 0; layer < layers; layer++) {
      worth = worth * USUAL_FALL;
      for (let tile = 0; tile < tiles; tile++) total[layer * tiles + tile] = worth * size[tile];
    }
    return total;
  }
  let weights = 0;
  for (const [viewpoint, weight] of nearest(eye, streaming.viewpoints)) {
    const there = coverage(boxes, streaming.viewpoints.subarray(3 * viewpoint, 3 * viewpoint + 3));
    const first = viewpoint * streaming.layers * tiles;
    for (let at = 0; at < total.length; at++) {
      const tile = at % tiles;
      const ratio = there[tile] > 0 ? size[tile] / there[tile] : 1;
      const level = streaming.gains[first + at];
      const gain = level > 0 ? GAINS[level] : 0;
      total[at] = total[at] + weight * (gain * Math.min(Math.max(ratio, 1 / MOST_RATIO), MOST_RATIO));
    }
    weights = weights + weight;
  }
  return total.map((gain) => gain / weights);
}

/** The nearest viewpoints, the first of equals first, and what each counts: by distance, the nearest 1. */
function nearest(eye: Point, viewpoints: Float32Array): [number, number][] {
  const distances = Array.from({ length: viewpoints.length / 3 }, (_, i) => {
    const [x, y, z] = difference(viewpoints.subarray(3 * i, 3 * i + 3), eye);
    return Math.sqrt(x * x + y * y + z * z);
  });
  const order = [...distances.keys()].sort((a, b) => distances[a] - distances[b] || a - b).slice(0, NEAREST);
  const least = distances[order[0]];
  return least === 0 ? [[order[0], 1]] : order.map((i) => [i, least / distances[i]]);
}

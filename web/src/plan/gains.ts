/** What a layer of a tile is worth, seen from anywhere. Twin of scarfmt/streaming/gains.py: the same numbers. */

import type { Streaming } from "../../../conformance/decoders/js/streaming.js";
import type { Point } from "../decoder/types.js";
import { coverage, difference, octaves, type Boxes } from "./boxes.js";

const GAIN_OF_ONE = 255;
/** How much larger or smaller than from a viewpoint a tile counts at most. */
const MOST_RATIO = 100;
/** What a byte of a layer is worth of what one of the layer before was, as is usual. */
const USUAL_FALL = 0.5;
/** What is usual weighs as much as this many viewpoints that are as far from the eye as the tile is. */
const USUAL_WEIGHT = 3;

const GAINS = octaves(-GAIN_OF_ONE - 1, GAIN_OF_ONE + 2).subarray(1);

/** Bytes of a layer (from 0) of a tile. */
export type CostOf = (tile: number, layer: number) => number;

/**
 * (layers, tiles): what each layer of each tile takes away of the squared error of a picture that has it in it. What
 * the file tells is of other places, and what is usual of no place: the nearer the viewpoints, beside how far the tile
 * is, the more counts what is told. Where the file tells nothing, all is as usual, in some unit.
 * @param layers of the file; the file may tell of more
 */
export function gainsFrom(
  eye: Point,
  boxes: Boxes,
  streaming: Streaming | null,
  layers: number,
  costOf: CostOf,
): Float64Array {
  const usual = usualGains(eye, boxes, layers, costOf);
  if (streaming === null || streaming.viewpoints.length === 0) return usual;
  const told = toldGains(eye, boxes, streaming, layers);
  const whole = sum(told);
  const allUsual = sum(usual);
  if (!(whole > 0 && allUsual > 0)) return usual;
  const part = trust(eye, boxes, streaming.viewpoints);
  const tiles = part.length;
  return told.map((gain, at) => part[at % tiles] * gain + (1 - part[at % tiles]) * (usual[at] * (whole / allUsual)));
}

/** (tiles): part of a gain that is what viewpoints tell; the rest is what is usual. */
function trust(eye: Point, boxes: Boxes, viewpoints: Float32Array): Float64Array {
  const least = Math.min(...squaredDistances(eye, viewpoints));
  let total = 0;
  for (const weight of weights(eye, viewpoints)) total = total + weight;
  const far = USUAL_WEIGHT * (least / total);
  return Float64Array.from(squaredDistances(eye, boxes.middle), (squared) =>
    squared + far > 0 ? squared / (squared + far) : 1,
  );
}

function sum(gains: Float64Array): number {
  let total = 0;
  for (const gain of gains) total = total + gain;
  return total;
}

/** A mean of what is told from all viewpoints: the nearer count more, by the square of their distance. */
function toldGains(eye: Point, boxes: Boxes, streaming: Streaming, layers: number): Float64Array {
  const size = coverage(boxes, eye);
  const tiles = size.length;
  const total = new Float64Array(layers * tiles);
  let all = 0;
  weights(eye, streaming.viewpoints).forEach((weight, viewpoint) => {
    const there = coverage(boxes, streaming.viewpoints.subarray(3 * viewpoint, 3 * viewpoint + 3));
    const first = viewpoint * streaming.layers * tiles;
    for (let at = 0; at < total.length; at++) {
      const tile = at % tiles;
      const ratio = there[tile] > 0 ? size[tile] / there[tile] : 1;
      const level = streaming.gains[first + at];
      const gain = level > 0 ? GAINS[level] : 0;
      total[at] = total[at] + weight * (gain * Math.min(Math.max(ratio, 1 / MOST_RATIO), MOST_RATIO));
    }
    all = all + weight;
  });
  return total.map((gain) => gain / all);
}

/** What looks larger counts more, and later layers less; encoders spend more bytes where there is more to see. */
function usualGains(eye: Point, boxes: Boxes, layers: number, costOf: CostOf): Float64Array {
  const size = coverage(boxes, eye);
  const tiles = size.length;
  const total = new Float64Array(layers * tiles);
  let worth = 1;
  for (let layer = 0; layer < layers; layer++) {
    worth = worth * USUAL_FALL;
    for (let tile = 0; tile < tiles; tile++) total[layer * tiles + tile] = worth * size[tile] * costOf(tile, layer);
  }
  return total;
}

/** What each viewpoint counts; where the eye is at one of them, that one alone. */
function weights(eye: Point, viewpoints: Float32Array): number[] {
  const squared = squaredDistances(eye, viewpoints);
  const least = Math.min(...squared);
  if (least === 0) return squared.map((_, i) => (i === squared.indexOf(0) ? 1 : 0));
  return squared.map((value) => least / value);
}

function squaredDistances(eye: Point, points: Float32Array | Float64Array): number[] {
  return Array.from({ length: points.length / 3 }, (_, i) => {
    const [x, y, z] = difference(points.subarray(3 * i, 3 * i + 3), eye);
    return x * x + y * y + z * z;
  });
}

/** STREAMING (SPEC §7.13): where the content of tiles shows, and a view to begin with. */

import { Reader } from "./reader.js";

export interface Streaming {
  tiles: number;
  /** (10) position, target, up, vertical field in radians. */
  view: number[] | null;
  /** (tiles, 3) corners of the tight boxes in 1/256 of the side of a tile. */
  low: Uint8Array;
  /** (tiles, 3) within the box. */
  high: Uint8Array;
  /** (tiles) how far splats stick out, in quarters of an octave. */
  reach: Uint8Array;
}

const VIEW = 10;

/** Throws Refused where a rule of §7.13 is broken. @param block its bytes @param offset where they are in the file */
export function parseStreaming(block: Uint8Array, offset = 0): Streaming {
  const reader = new Reader(block, offset);
  const tiles = reader.u32();
  const views = reader.u8();
  reader.demand(views <= 1, "bad-streaming", "more than one view");
  const view = Array.from({ length: views * VIEW }, () => reader.f32());
  if (view.length > 0) {
    const field = view[VIEW - 1];
    reader.demand(view.every(Number.isFinite) && field > 0 && field < Math.PI, "bad-streaming", "no view");
  }
  const low = reader.take(3 * tiles);
  const high = reader.take(3 * tiles);
  reader.demand(low.every((corner, i) => corner <= high[i]), "bad-streaming", "a box ends before it begins");
  const reach = reader.take(tiles);
  reader.end();
  return { tiles, view: view.length > 0 ? view : null, low, high, reach };
}

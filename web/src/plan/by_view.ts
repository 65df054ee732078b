/** In which order to fetch layers of tiles. */

import { coverage, tightBoxes } from "./boxes.js";
import type { FileIndex, Planner, Step } from "./types.js";
import { shareInPicture, soon } from "./view.js";

/** Part of a tile that counts as in the picture where none is: a camera may turn, and splats stick out. */
const BEHIND = 0.02;
/** What a byte of a layer is worth, of what one of the layer before is. */
const FALL = 0.5;

/**
 * First layer 1 of every tile in the picture, so that there are no holes; then all others. What looks larger comes first,
 * later layers count less. Equals go by layer, then tile. Without a camera the order is that of the file.
 */
export const byView: Planner = {
  plan(index, camera, have) {
    if (camera === null) return inFileOrder(index, have);
    const boxes = tightBoxes(index.boxes, index.streaming);
    const share = shareInPicture(boxes, camera);
    const worth = coverage(boxes, soon(camera)).map((size, tile) => size * Math.max(share[tile], BEHIND));
    const [first, then]: [Step[], Step[]] = [[], []];
    for (const { tile, layer } of inFileOrder(index, have)) {
      (layer === 1 && share[tile] > 0 ? first : then).push({ tile, layer });
    }
    const order = (a: Step, b: Step) =>
      worth[b.tile] * FALL ** b.layer - worth[a.tile] * FALL ** a.layer || a.layer - b.layer || a.tile - b.tile;
    return first.sort(order).concat(then.sort(order));
  },
};

/** Layer by layer, tiles in Morton order, as blocks lie in the file. */
function inFileOrder({ tiles, layers }: FileIndex, have: Uint8Array): Step[] {
  const steps: Step[] = [];
  for (let layer = 1; layer <= layers; layer++) {
    for (let tile = 0; tile < tiles; tile++) if (have[tile] < layer) steps.push({ tile, layer });
  }
  return steps;
}

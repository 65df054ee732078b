/** The order in which blocks lie in the file: layer by layer, tiles in Morton order. */

import type { Planner, SceneIndex, Step } from "./types.js";

/** @param have (tiles) layers that each tile has */
export function inFileOrder({ tiles, layers }: SceneIndex, have: Uint8Array): Step[] {
  const steps: Step[] = [];
  for (let layer = 1; layer <= layers; layer++) {
    for (let tile = 0; tile < tiles; tile++) if (have[tile] < layer) steps.push({ tile, layer });
  }
  return steps;
}

/** Looks at no camera. */
export const fileOrder: Planner = { plan: (index, _annotation, _camera, have) => inFileOrder(index, have) };

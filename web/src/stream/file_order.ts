/** The order in which blocks lie in the file: layer by layer, tiles in Morton order. */

import type { Planner, SceneIndex, Step } from "../plan/types.js";

function plan({ tiles, layers }: SceneIndex, _annotation: unknown, _camera: unknown, have: Uint8Array): Step[] {
  const steps: Step[] = [];
  for (let layer = 1; layer <= layers; layer++) {
    for (let tile = 0; tile < tiles; tile++) if (have[tile] < layer) steps.push({ tile, layer });
  }
  return steps;
}

/** Looks at no camera. */
export const fileOrder: Planner = { plan };

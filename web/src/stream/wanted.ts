/** From steps of a plan to blocks of the file. */

import type { Step } from "../plan/types.js";
import type { ParsedFront } from "./front.js";

/**
 * Blocks in the order to fetch: before the first tile of a layer the models of that layer and those before.
 * @param annotation entry that the planner wants to see, after the first models; -1 for none
 */
export function wantedEntries(front: ParsedFront, steps: Step[], annotation: number): number[] {
  const { modelEntries, tileEntries, index } = front;
  const entries: number[] = [];
  let models = 0;
  for (const { tile, layer } of steps) {
    for (; models < layer; models++) {
      entries.push(...modelEntries[models]);
      if (models === 0 && annotation >= 0) entries.push(annotation);
    }
    const entry = tileEntries[tile * index.layers + layer - 1];
    if (entry >= 0) entries.push(entry);
  }
  return entries;
}

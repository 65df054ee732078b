/** From steps of a plan to pages and blocks of the file. */

import type { Step } from "../plan/types.js";
import type { Directory } from "../format/directory.js";

/** What the block STREAMING may take at once, bytes, and how many times its bytes come before it where it takes more. */
const SMALL = 64 * 1024;
const SHARE = 8;

/**
 * Entries in the order to fetch: before the first tile of a layer the models of that layer and those before. In place
 * of blocks of which nothing is known yet, the pages that tell of them.
 * @param streaming entry of the block STREAMING, which comes after the first models; -1 for none
 * @param thumbnail entry of the block THUMBNAIL, which comes first of all; -1 for none
 */
export function wantedEntries(directory: Directory, steps: Step[], streaming: number, thumbnail = -1): number[] {
  const { numbers, entries } = directory;
  const wanted: number[] = thumbnail >= 0 && steps.length > 0 ? [thumbnail] : [];
  const pages = new Set<number>();
  const addPage = (page: number) => {
    if (!directory.isOpen(page) && !pages.has(page)) wanted.push(page);
    pages.add(page);
  };
  let models = 0;
  for (const { tile, layer } of steps) {
    for (; models < layer; models++) wanted.push(...numbers.models(models + 1));
    const page = directory.pageOf(tile);
    addPage(numbers.tilePage(page));
    addPage(numbers.rowPage(layer, page));
    const block = numbers.tileBlock(tile, layer);
    if (entries.length[block] > 0 && directory.isPlaced(tile)) wanted.push(block);
  }
  if (streaming >= 0 && wanted.length > 0) wanted.splice(placeOf(directory, wanted, streaming), 0, streaming);
  return wanted;
}

/** A small block comes after the first models; what is large would keep the scene waiting. */
function placeOf({ numbers, entries }: Directory, wanted: number[], streaming: number): number {
  const size = entries.length[streaming];
  const afterModels = 1 + wanted.lastIndexOf(numbers.models(1).at(-1) ?? -1);
  if (size <= SMALL) return afterModels;
  let before = 0;
  const past = wanted.findIndex((entry) => (before += entries.length[entry]) > SHARE * size);
  return past < 0 ? wanted.length : Math.max(past, afterModels);
}

/** Which files of a scene to have open for a view, and what part of the budgets each may use. */

import { placeBytes } from "../pack/places.js";
import { coverage, tightBoxes } from "../plan/boxes.js";
import type { Budgets, Camera } from "../plan/types.js";
import { shareInPicture, soon } from "../plan/view.js";
import type { ListedFile } from "./document.js";

export interface Share {
  file: number;
  /** Layers that fit. */
  layers: number;
  budgets: Budgets;
}

/** Bytes that decoders hold for a file besides its tiles. */
export const OPEN_BYTES = 8 << 20;
/** Of a Gaussian, before decoders have said what they hold of it. */
const STATE_BYTES = 128;
/** Tiles take places in runs, which are not all full. */
const SLACK = 1.2;
/** What a Gaussian of a layer is worth of what one of the layer before was. */
const FALL = 0.5;
/** What is not in the picture counts as little of it, so that it comes after all else. */
const BEHIND = 0.02;

interface Part {
  /** Whether it is layer 1 of a file in the picture. */
  first: boolean;
  worth: number;
  file: number;
  layer: number;
  splats: number;
  bytes: number;
}

/**
 * First layer 1 of every file in the picture, those that look largest first, so that there are no holes; then layers by
 * how large their file looks and how late they are, as long as they fit. What is over goes to all files alike.
 * @param boxes (files, 6) in the scene
 * @param camera null: no view yet, files in the order of the index
 * @param most files that may be open
 * @returns files in the order to open them
 */
export function shares(
  files: ListedFile[],
  boxes: Float64Array,
  camera: Camera | null,
  budgets: Budgets,
  most: number,
): Share[] {
  const parts = partsOf(files, looks(boxes, camera)).sort(order);
  const found = new Map<number, Share>();
  const left = { splats: budgets.splats, bytes: budgets.bytes };
  for (const { file, layer, splats, bytes } of parts) {
    const share = found.get(file) ?? { file, layers: 0, budgets: { splats: 0, bytes: OPEN_BYTES } };
    const opening = share.layers === 0 && layer === 1 ? OPEN_BYTES : 0;
    if (share.layers !== layer - 1 || (opening > 0 && (found.size >= most || left.bytes < opening))) continue;
    const part = Math.min(1, left.splats / Math.max(splats, 1), (left.bytes - opening) / Math.max(bytes, 1));
    if (part <= 0) continue;
    found.set(file, share);
    share.budgets.splats += part * splats;
    share.budgets.bytes += part * bytes;
    left.splats -= part * splats;
    left.bytes -= part * bytes + opening;
    if (part === 1) share.layers = layer;
  }
  for (const share of found.values()) {
    share.budgets.splats += left.splats / found.size;
    share.budgets.bytes += left.bytes / found.size;
  }
  return [...found.values()];
}

/** (files): how large each looks, and whether it is in the picture; all equal before the first view. */
function looks(boxes: Float64Array, camera: Camera | null): { size: number; seen: boolean }[] {
  if (camera === null) return Array.from({ length: boxes.length / 6 }, () => ({ size: 1, seen: true }));
  const all = tightBoxes(boxes, null);
  const share = shareInPicture(all, camera);
  const sizes = coverage(all, soon(camera));
  return Array.from(sizes, (size, file) => ({ size: size * Math.max(share[file], BEHIND), seen: share[file] > 0 }));
}

function partsOf(files: ListedFile[], look: { size: number; seen: boolean }[]): Part[] {
  return files.flatMap(({ layers, shDegree }, file) =>
    layers.map(({ gaussians }, k) => {
      const splats = SLACK * (gaussians - (k === 0 ? 0 : layers[k - 1].gaussians));
      const bytes = splats * (placeBytes(shDegree) + STATE_BYTES);
      const { size, seen } = look[file];
      return { first: k === 0 && seen, worth: size * FALL ** k, file, layer: k + 1, splats, bytes };
    }),
  );
}

function order(a: Part, b: Part): number {
  return Number(b.first) - Number(a.first) || b.worth - a.worth || a.file - b.file || a.layer - b.layer;
}

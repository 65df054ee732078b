/** What an index says of a scene before any of its files is opened, and whether a file is the one that it means. */

import type { SceneIndex } from "../plan/types.js";
import type { Front } from "../stream/directory.js";
import { StreamError } from "../stream/errors.js";
import { COLOUR_SPACES, FRAMES, type ListedFile, PROFILES, type SceneDocument } from "./document.js";
import { placedBox } from "./placement.js";

/** The largest number of an index's counts: files beyond it weigh alike. */
const MOST_COUNT = 2 ** 32 - 1;

/** As the front of a file, with files in place of tiles. */
export interface SceneFront {
  document: SceneDocument;
  header: { coordinate_frame: number; file_length: number };
  /** After each layer of the scene, all files together (R-17-10). */
  layers: { anchor_count: number; gaussian_count: number; end_offset: number }[];
  /** Boxes of files, and Gaussians of their layers. */
  index: SceneIndex;
  total: number;
}

export function sceneFront(document: SceneDocument): SceneFront {
  const { files } = document;
  const k = Math.max(...files.map(({ layers }) => layers.length));
  const after = (file: ListedFile, layer: number) => file.layers[Math.min(layer, file.layers.length) - 1];
  const sum = (of: (file: ListedFile) => number) => files.reduce((total, file) => total + of(file), 0);
  const layers = Array.from({ length: k }, (_, i) => ({
    anchor_count: sum((file) => after(file, i + 1).anchors),
    gaussian_count: sum((file) => after(file, i + 1).gaussians),
    end_offset: sum((file) => after(file, i + 1).end),
  }));
  const index: SceneIndex = {
    tiles: files.length,
    layers: k,
    slots: 1,
    boxes: new Float64Array(6 * files.length),
    bytes: new Float64Array(files.length * k),
    counts: new Uint32Array(files.length * k),
    modelBytes: new Float64Array(k),
  };
  files.forEach((file, f) => {
    index.boxes.set(placedBox(file.placement, file.box), 6 * f);
    file.layers.forEach(({ end, gaussians }, i) => {
      const before = i === 0 ? { end: 0, gaussians: 0 } : file.layers[i - 1];
      index.bytes[f * k + i] = end - before.end;
      index.counts[f * k + i] = Math.min(gaussians - before.gaussians, MOST_COUNT);
    });
  });
  const header = { coordinate_frame: FRAMES.indexOf(document.coordinateFrame), file_length: sum(({ length }) => length) };
  return { document, header, layers, index, total: layers[k - 1].gaussian_count };
}

/** R-17-8: what the index says of a file is what its header says. @returns what is wrong, null where they agree */
export function difference(document: SceneDocument, file: ListedFile, { header, layers }: Front): StreamError | null {
  const listed = file.layers.map(({ end, anchors, gaussians }) => [end, anchors, gaussians]);
  const found = layers.map(({ end_offset, anchor_count, gaussian_count }) => [end_offset, anchor_count, gaussian_count]);
  const pairs: [string, unknown, unknown][] = [
    ["length", file.length, header.file_length],
    ["header_crc32", file.headerCrc32, header.header_crc32],
    ["profile", file.profile, PROFILES[header.profile]],
    ["sh_degree", file.shDegree, header.sh_degree],
    ["slots", file.slots, header.slots],
    ["layers", String(listed), String(found)],
    ["coordinate_frame", document.coordinateFrame, FRAMES[header.coordinate_frame]],
    ["colour_space", document.colourSpace, COLOUR_SPACES[header.colour_space]],
  ];
  const wrong = pairs.find(([, here, there]) => here !== there);
  if (wrong === undefined) return null;
  const [name, here, there] = wrong;
  return new StreamError("scene-file", `${file.uri}: ${name} is ${there}, the index of the scene says ${here}`);
}

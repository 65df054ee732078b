/** Indices of entropy mode 0 (SPEC §7.6). */

import { MAX_STAGES } from "./constants.js";
import { demand } from "./errors.js";

/**
 * @typedef {import("./groups.js").Groups} Groups
 * @typedef {import("./tile.js").Tile} Tile
 * @typedef {import("./trace.js").Trace} Trace
 */

/**
 * `read_indices`.
 * @param {Tile} tile
 * @param {number} k
 * @param {Groups} groups
 * @param {Trace | null} trace
 */
export function readIndices(tile, k, groups, trace) {
  const { rows, codebooks } = tile.models;
  const before = rows[k - 1].stages;
  const after = rows[k].stages;
  for (let stage = 1; stage <= MAX_STAGES; stage++) {
    const anchors = tile.select((c) => before[c] < stage && stage <= after[c]);
    if (anchors.length === 0) continue;
    const size = codebooks[stage === 1 ? 0 : 1]?.size ?? 0;
    const contexts = Uint8Array.from(anchors, (a) => {
      const zero = stage > 1 && tile.index[a * tile.stages + stage - 2] === 0;
      return 16 * tile.ofClass[a] + (zero ? 1 : 0);
    });
    const values = new Int32Array(anchors.length);
    trace?.atStage(stage);
    groups.readByContext(stage, 0, contexts, anchors.length, values);
    trace?.atStage(null);
    for (const value of values) demand(value >= 0 && value < size, "bad-index", `index ${value} of ${size}`);
    for (let m = 0; m < anchors.length; m++) tile.index[anchors[m] * tile.stages + stage - 1] = values[m];
  }
}


/** Channel values of one tile and layer (SPEC §7.5, §8.4, §10.3). */

import { clamp } from "./integers.js";
import { fine, passesOf, Surroundings } from "./cells.js";
import { Refused } from "./errors.js";
import { NO_SOURCE } from "./layer_block.js";
import { predictorKey } from "./models.js";
import { isAttribute } from "./predictors.js";
import { MAX_STEPS, STREAM_NAMES } from "./constants.js";

/**
 * @typedef {import("./groups.js").Groups} Groups
 * @typedef {import("./predictors.js").Predictor} Predictor
 * @typedef {import("./tile.js").Tile} Tile
 * @typedef {import("./trace.js").Trace} Trace
 */

const LARGEST_VALUE = 2 ** 31 - 1;
const LARGEST_INPUT = 511;

/**
 * `read_channel` of channel i in layer k.
 * @param {Tile} tile
 * @param {number} k from 1
 * @param {number} i
 * @param {Groups} groups
 * @param {Trace | null} trace
 */
export function readChannel(tile, k, i, groups, trace) {
  const { rows, channels, predictors } = tile.models;
  const before = rows[k - 1].steps[i];
  const after = rows[k].steps[i];
  const { stream, components } = channels[i];
  for (let n = 1; n <= MAX_STEPS; n++) {
    const anchors = tile.select((c) => before[c] < n && n <= after[c]);
    if (anchors.length === 0) continue;
    const inForce = Array.from({ length: components }, (_, j) => predictors[k - 1].get(predictorKey(stream, j, n)));
    if (inForce.some((predictor) => predictor !== undefined)) {
      readPredictedStep({ tile, k, i, n, groups, inForce, trace }, anchors);
    } else {
      readStep(tile, i, n, anchors, groups);
    }
  }
}

/**
 * @param {Tile} tile
 * @param {number} i
 * @param {number} n
 * @param {Uint32Array} anchors
 * @param {Groups} groups
 */
function readStep(tile, i, n, anchors, groups) {
  const { components } = tile.models.channels[i];
  const contexts = new Uint8Array(anchors.length);
  const refinements = Array.from({ length: n === 1 ? 1 : components }, () => new Int32Array(anchors.length));
  for (let j = 0; j < components; j++) {
    tableContexts(tile, i, j, n, anchors, contexts);
    const values = n === 1 ? refinements[0] : refinements[j];
    groups.readByContext(j, n, contexts, anchors.length, values);
    if (n === 1) storeFirst(tile, i, j, anchors, values);
  }
  if (n > 1) refine(tile, i, anchors, refinements);
}

/**
 * First values are those of an alphabet, so R-7.5-2 holds.
 * @param {Tile} tile
 * @param {number} i
 * @param {number} j
 * @param {Uint32Array} anchors
 * @param {Int32Array} values
 */
function storeFirst(tile, i, j, anchors, values) {
  const { components } = tile.models.channels[i];
  const v = tile.v[i];
  const first = tile.first[i];
  for (let m = 0; m < anchors.length; m++) {
    const at = anchors[m] * components + j;
    v[at] = values[m];
    if (first !== null) first[at] = values[m];
  }
}

/**
 * R-7.5-1 for all components, then R-7.5-2.
 * @param {Tile} tile
 * @param {number} i
 * @param {Uint32Array} anchors
 * @param {Int32Array[]} refinements one array a component
 */
function refine(tile, i, anchors, refinements) {
  for (const values of refinements) {
    for (const t of values) if (t < -1 || t > 1) throw new Refused("bad-trit", `a refinement of ${t}`);
  }
  const v = tile.v[i];
  refinements.forEach((values, j) => {
    for (let m = 0; m < anchors.length; m++) {
      const at = anchors[m] * refinements.length + j;
      const value = 3 * v[at] + values[m];
      if (Math.abs(value) > LARGEST_VALUE) throw new Refused("value-range", `a channel value of ${value}`);
      v[at] = value;
    }
  });
}

/**
 * `first_contexts`, or `trit_contexts` where n is above 1.
 * @param {Tile} tile
 * @param {number} i
 * @param {number} j
 * @param {number} n
 * @param {Uint32Array} anchors
 * @param {Uint8Array} out
 */
function tableContexts(tile, i, j, n, anchors, out) {
  const { channels } = tile.models;
  const rule = channels[i].rules[j];
  for (let m = 0; m < anchors.length; m++) out[m] = rule.by_class === 1 ? 16 * tile.ofClass[anchors[m]] : 0;
  if (n > 1) {
    const v = tile.v[i];
    const { components } = channels[i];
    for (let m = 0; m < anchors.length; m++) out[m] += clamp(v[anchors[m] * components + j], -2, 2) + 2;
  } else if (rule.source_channel !== NO_SOURCE) {
    const first = /** @type {Int32Array} */ (tile.first[rule.source_channel]);
    const { components } = channels[rule.source_channel];
    const scale = 2 ** rule.shift;
    for (let m = 0; m < anchors.length; m++) {
      const source = first[anchors[m] * components + rule.source_component];
      out[m] += clamp(Math.floor((source - rule.low) / scale), 0, 15);
    }
  }
}

/**
 * A step of a channel in a layer, with the predictors of its components.
 * @typedef {{tile: Tile, k: number, i: number, n: number, groups: Groups, inForce: (Predictor | undefined)[],
 *   trace: Trace | null}} Step
 */

/**
 * `read_predicted_step`.
 * @param {Step} step
 * @param {Uint32Array} anchors
 */
function readPredictedStep(step, anchors) {
  const { tile, k, i, n } = step;
  const { channels, context, rows } = tile.models;
  const { components } = channels[i];
  const before = rows[k - 1].steps[i];
  const known = new Surroundings(tile.depths(), components);
  for (let a = 0; a < tile.size; a++) {
    if (before[tile.ofClass[a]] >= n) known.add(a, fineRow(tile, i, a, before[tile.ofClass[a]]));
  }
  for (const pass of passesOf(tile.inCodeOrder(anchors), context.passes_log2)) {
    readPass(step, known, pass);
    for (const a of pass) known.add(a, fineRow(tile, i, a, n));
  }
}

/**
 * @param {Tile} tile
 * @param {number} i
 * @param {number} a
 * @param {number} n steps that v has
 * @returns {number[]} (components)
 */
function fineRow(tile, i, a, n) {
  const { components } = tile.models.channels[i];
  const row = new Array(components);
  for (let c = 0; c < components; c++) row[c] = fine(tile.v[i][a * components + c], n);
  return row;
}

/**
 * @param {Step} step
 * @param {Surroundings} known
 * @param {Uint32Array} pass
 */
function readPass(step, known, pass) {
  const { tile, i, n, groups, inForce, trace } = step;
  const { stream, components } = tile.models.channels[i];
  const inputs = new PassInputs(step, known, pass);
  const contexts = new Uint8Array(pass.length);
  const refinements = Array.from({ length: components }, () => new Int32Array(pass.length));
  for (let j = 0; j < components; j++) {
    const predictor = inForce[j];
    if (predictor === undefined) {
      tableContexts(tile, i, j, n, pass, contexts);
    } else {
      for (let m = 0; m < pass.length; m++) {
        inputs.fill(m, j, predictor.x);
        contexts[m] = predictor.context(tile.ofClass[pass[m]]);
      }
      trace?.onNumbers(`context.${STREAM_NAMES[stream]}.${j}.${n}`, Int32Array.from(contexts));
    }
    groups.readByContext(j, n, contexts, pass.length, refinements[j]);
    if (n === 1) storeFirst(tile, i, j, pass, refinements[j]);
  }
  if (n > 1) refine(tile, i, pass, refinements);
}

/** The inputs of the predictors of a channel for the anchors of a pass, after the class columns. */
class PassInputs {
  /**
   * @param {Step} step
   * @param {Surroundings} known
   * @param {Uint32Array} pass
   */
  constructor({ tile, k, i, n }, known, pass) {
    const { channels } = tile.models;
    this.components = channels[i].components;
    this.depths = known.depths.length;
    this.power = 3 ** (n - 1);
    this.firstStep = n === 1;
    this.pass = pass;
    this.v = tile.v[i];
    this.earlier = channels.flatMap(({ stream, components }, c) =>
      c < i && isAttribute(stream) ? [{ components, values: tile.fineAfter(k, c) }] : [],
    );
    this.fine0 = new Int32Array(pass.length * this.components);
    this.means = new Float64Array(pass.length * this.depths * this.components);
    this.counts = new Int32Array(pass.length * this.depths);
    for (let m = 0; m < pass.length; m++) {
      this.fine0.set(fineRow(tile, i, pass[m], n - 1), m * this.components);
      known.around(pass[m], this.means, m * this.depths * this.components, this.counts, m * this.depths);
    }
  }

  /**
   * @param {number} m in the pass
   * @param {number} j component
   * @param {Int32Array} x
   */
  fill(m, j, x) {
    const { components, depths, means, counts, fine0, pass } = this;
    let at = 0;
    for (const earlier of this.earlier) {
      const from = pass[m] * earlier.components;
      for (let c = 0; c < earlier.components; c++) x[at++] = limited(earlier.values[from + c] >> 6);
    }
    for (let c = 0; c < components; c++) {
      const own = this.firstStep && c < j ? fine(this.v[pass[m] * components + c], 1) : fine0[m * components + c];
      x[at++] = limited(own >> 6);
    }
    const row = m * depths * components;
    for (let c = 0; c < depths * components; c++) x[at++] = limited(means[row + c] >> 6);
    for (let d = 0; d < depths; d++) x[at++] = limited(counts[m * depths + d]);
    const own = fine0[m * components + j];
    for (let d = 0; d < depths; d++) {
      // Exact below 2^53; what is above is limited all the same.
      x[at++] = limited(Math.floor(((means[row + d * components + j] - own) * this.power + 16) / 32));
    }
  }
}

/** @param {number} x */
function limited(x) {
  return x > LARGEST_INPUT ? LARGEST_INPUT : x < -LARGEST_INPUT ? -LARGEST_INPUT : x;
}

/**
 * `read_offsets` of channel i.
 * @param {Tile} tile
 * @param {number} k
 * @param {number} i
 * @param {Groups} groups
 */
export function readOffsets(tile, k, i, groups) {
  const { slots } = tile;
  /** @type {number[]} */
  const pairs = [];
  for (let s = 0; s < tile.slotLayer.length; s++) if (tile.slotLayer[s] === k) pairs.push(s);
  const contexts = new Uint8Array(pairs.length);
  const values = new Int32Array(pairs.length);
  tile.models.channels[i].rules.forEach((rule, j) => {
    pairs.forEach((pair, m) => {
      contexts[m] = rule.by_class === 1 ? 16 * tile.ofClass[Math.floor(pair / slots)] : 0;
    });
    groups.readByContext(j, 1, contexts, pairs.length, values);
    pairs.forEach((pair, m) => {
      tile.v[i][pair * 3 + j] = values[m];
    });
  });
}

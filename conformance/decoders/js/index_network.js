/** Indices of entropy mode 1: the index network (SPEC §10.5). */

import { passesOf } from "./cells.js";
import { MAX_STAGES } from "./constants.js";
import { activationLimit, applyLinear, exp2w, product } from "./integers.js";
import { NetworkInputs } from "./network_inputs.js";
import { NetworkStates } from "./network_states.js";

/**
 * @typedef {import("./groups.js").Groups} Groups
 * @typedef {import("./integers.js").Linear} Linear
 * @typedef {import("./models.js").Models} Models
 * @typedef {import("./network_block.js").Network} Network
 * @typedef {import("./rans.js").RansStream} RansStream
 * @typedef {import("./tile.js").Tile} Tile
 * @typedef {import("./trace.js").Trace} Trace
 */

const TOTAL = 2 ** 24;

export class IndexNetwork {
  /** @param {Models} models of a file with a network */
  constructor(models) {
    const net = /** @type {Network} */ (models.network);
    this.models = models;
    this.net = net;
    this.amax = activationLimit(net.activationBits);
    const H = net.hidden;
    /** Wi e of the codewords of each codebook (size, 3H). */
    this.fromCodeword = models.vectors.map(({ e }, b) => productOfAll(net.recurrent[0].wi[b], 3 * H, e));
    /** Wh g + bh of the start of each recurrent layer (3H). */
    this.fromStart = net.recurrent.map(({ wh, bh, start }) => {
      const out = new Int32Array(3 * H);
      product(wh, 3 * H, H, start, 0, bh, out, 0);
      return out;
    });
    const { mixer, mixed } = net;
    /** The halves of the mixer that look at h and at c (Y, H). */
    this.mixH = halfOf(mixer, 0, H);
    this.mixC = halfOf(mixer, H, H);
    this.noBiases = new Int32Array(Math.max(mixed, 3 * H));
    this.x = new Int32Array(net.inputs);
    this.embedded = new Int32Array(net.embedWidth);
    this.px = new Int32Array(3 * H);
    this.ph = new Int32Array(3 * H);
    this.c = new Int32Array(H);
    this.y = new Int32Array(mixed);
    this.o = new Int32Array(net.codewordDims + 1);
    const most = Math.max(...net.heads.map(({ size }) => size));
    this.logits = new Int32Array(most);
    this.sums = new Int32Array(most + 1);
  }

  /**
   * `read_neural_indices`.
   * @param {Tile} tile
   * @param {number} k
   * @param {Groups} groups
   * @param {Trace | null} trace
   */
  readIndices(tile, k, groups, trace) {
    const { rows, context } = this.models;
    const before = rows[k - 1].stages;
    const after = rows[k].stages;
    const anchors = tile.select((c) => before[c] < after[c]);
    if (anchors.length === 0) return;
    const view = new NetworkInputs(this.net, this.models, tile, k);
    for (let a = 0; a < tile.size; a++) if (before[tile.ofClass[a]] > 0) view.add(a, before[tile.ofClass[a]]);
    for (const pass of passesOf(tile.inCodeOrder(anchors), context.passes_log2)) {
      const states = new NetworkStates(this, view, pass, trace);
      for (let stage = 1; stage <= MAX_STAGES; stage++) {
        const members = [...pass.keys()].filter((p) => {
          const c = tile.ofClass[pass[p]];
          return before[c] < stage && stage <= after[c];
        });
        if (members.length > 0) this.#readStage(stage, Uint32Array.from(members), states, groups.rans, trace);
      }
      for (const a of pass) view.add(a, after[tile.ofClass[a]]);
    }
  }

  /**
   * `read_stage`.
   * @param {number} stage
   * @param {Uint32Array} members positions in the pass
   * @param {NetworkStates} states
   * @param {RansStream} rans
   * @param {Trace | null} trace
   */
  #readStage(stage, members, states, rans, trace) {
    const { tile } = states.view;
    const book = stage === 1 ? 0 : 1;
    const head = this.net.heads[book];
    const { e, centroids, deviations, starts } = this.models.vectors[book];
    const width = this.net.codewordDims + 1;
    const store = (/** @type {number} */ p, /** @type {number} */ index) => {
      tile.index[states.pass[p] * tile.stages + stage - 1] = index;
    };
    const name = `INDICES.${stage}`;
    if (head.clusters.length === 0) {
      for (const p of members) {
        states.mixed(p, stage, this.y);
        this.#project(head.project1, this.y, 0, this.o);
        store(p, this.#symbol(e, 0, head.size, this.o, 0, head.biases, head.shift, rans, trace, name));
      }
      return;
    }
    const project2 = /** @type {Linear} */ (head.project2);
    const inCluster = new Uint16Array(members.length);
    const o2 = new Int32Array(members.length * width);
    const count = head.clusters.length;
    members.forEach((p, q) => {
      states.mixed(p, stage, this.y);
      this.#project(head.project1, this.y, 0, this.o);
      applyLinear(project2, this.y, 0, -this.amax, this.amax, o2, q * width);
      inCluster[q] = this.#symbol(centroids, 0, count, this.o, 0, head.clusterBiases, head.shift, rans, trace, name);
    });
    /** @type {number[][]} */
    const ofCluster = head.clusters.map(() => []);
    inCluster.forEach((cluster, q) => ofCluster[cluster].push(q));
    ofCluster.forEach((some, i) => {
      const first = starts[i];
      const n = head.clusters[i];
      for (const q of some) {
        const m = this.#symbol(deviations, first, n, o2, q * width, head.biases, head.memberShift, rans, trace, name);
        store(members[q], first + m);
      }
    });
  }

  /**
   * @param {Linear} layer
   * @param {Int32Array} y
   * @param {number} at
   * @param {Int32Array} out
   */
  #project(layer, y, at, out) {
    applyLinear(layer, y, at, -this.amax, this.amax, out, 0);
  }

  /**
   * `symbol(frequencies(logits(...)))` of the n vectors from `first` on.
   * @param {Int32Array} vectors (.., R + 1)
   * @param {number} first
   * @param {number} n
   * @param {Int32Array} o
   * @param {number} at of the vector in o
   * @param {Int32Array} biases
   * @param {number} shift
   * @param {RansStream} rans
   * @param {Trace | null} trace
   * @param {string} name
   * @returns {number} 0..n - 1
   */
  #symbol(vectors, first, n, o, at, biases, shift, rans, trace, name) {
    if (n === 1) {
      trace?.firstFrequencies(name, () => Uint32Array.of(TOTAL));
      return 0;
    }
    const { logits, sums } = this;
    const width = this.net.codewordDims + 1;
    product(
      first === 0 ? vectors : vectors.subarray(first * width, (first + n) * width),
      n,
      width,
      o,
      at,
      first === 0 ? biases : biases.subarray(first, first + n),
      logits,
      0,
    );
    const add = (1 << shift) >> 1;
    let most = -(2 ** 31);
    for (let i = 0; i < n; i++) {
      const logit = (logits[i] + add) >> shift;
      logits[i] = logit;
      if (logit > most) most = logit;
    }
    let sum = 0;
    for (let i = 0; i < n; i++) {
      sums[i] = sum;
      const d = most - logits[i];
      if (d <= 511) sum += exp2w(d);
    }
    sums[n] = sum;
    trace?.firstFrequencies(name, () =>
      Uint32Array.from({ length: n }, (_, i) => cumulative(sums, n, i + 1) - cumulative(sums, n, i)),
    );
    return takeSymbol(rans, sums, n);
  }
}

/**
 * c_i of §8.1; the product is below 2^53.
 * @param {Int32Array} sums C_0 .. C_n
 * @param {number} n
 * @param {number} i
 */
function cumulative(sums, n, i) {
  return Math.floor((sums[i] * (TOTAL - n)) / sums[n]) + i;
}

/**
 * @param {RansStream} rans
 * @param {Int32Array} sums
 * @param {number} n
 * @returns {number}
 */
function takeSymbol(rans, sums, n) {
  const { slot } = rans;
  let low = 0;
  let high = n - 1;
  let start = 0;
  while (low < high) {
    const middle = (low + high + 1) >>> 1;
    const c = cumulative(sums, n, middle);
    if (c <= slot) {
      low = middle;
      start = c;
    } else {
      high = middle - 1;
    }
  }
  rans.advance(start, cumulative(sums, n, low + 1) - start);
  return low;
}

/**
 * @param {Int32Array} weights (rows, columns)
 * @param {number} rows
 * @param {Int32Array} vectors (n, columns)
 * @returns {Int32Array} (n, rows)
 */
function productOfAll(weights, rows, vectors) {
  const columns = weights.length / rows;
  const n = vectors.length / columns;
  const out = new Int32Array(n * rows);
  const biases = new Int32Array(rows);
  for (let i = 0; i < n; i++) product(weights, rows, columns, vectors, i * columns, biases, out, i * rows);
  return out;
}

/**
 * Columns of a layer.
 * @param {Linear} layer
 * @param {number} first
 * @param {number} n
 * @returns {Int32Array} (rows, n)
 */
function halfOf({ rows, columns, weights }, first, n) {
  const half = new Int32Array(rows * n);
  for (let r = 0; r < rows; r++) half.set(weights.subarray(r * columns + first, r * columns + first + n), r * n);
  return half;
}

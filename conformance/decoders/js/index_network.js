/** Indices of entropy mode 1: the index network (SPEC §10.5). */

import { passesOf, Surroundings } from "./cells.js";
import { MAX_STAGES } from "./constants.js";
import { gridFeatures } from "./grid.js";
import { activationLimit, applyLinear, clamp, exp2w, product, roundShift, sigmoid12, tanh12 } from "./integers.js";
import { tileLattice } from "./lattice.js";
import { isAttribute } from "./predictors.js";

/**
 * @typedef {import("./groups.js").Groups} Groups
 * @typedef {import("./integers.js").Linear} Linear
 * @typedef {import("./models.js").Models} Models
 * @typedef {import("./network_block.js").Network} Network
 * @typedef {import("./network_block.js").Recurrent} Recurrent
 * @typedef {import("./rans.js").RansStream} RansStream
 * @typedef {import("./tile.js").Tile} Tile
 * @typedef {import("./trace.js").Trace} Trace
 */

const TOTAL = 2 ** 24;
const CLASS_INPUT = 64;
const SCORE_LIMIT = 127;
const KEPT_NUMBERS = 2 ** 25;

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
    const view = new TileView(this, tile, k);
    for (let a = 0; a < tile.size; a++) if (before[tile.ofClass[a]] > 0) view.add(a, before[tile.ofClass[a]]);
    for (const pass of passesOf(tile.inCodeOrder(anchors), context.passes_log2)) {
      const states = new States(this, view, pass, trace);
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
   * @param {States} states
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

/** What the network sees of a tile in one layer: the inputs of an anchor. */
class TileView {
  /**
   * @param {IndexNetwork} owner
   * @param {Tile} tile
   * @param {number} k
   */
  constructor(owner, tile, k) {
    const { net, models } = owner;
    this.owner = owner;
    this.tile = tile;
    this.columns = net.attributes + net.latents;
    this.known = new Surroundings(tile.depths(), this.columns);
    this.fine = models.channels.flatMap(({ stream, components }, i) =>
      isAttribute(stream) ? [{ components, values: tile.fineAfter(k, i) }] : [],
    );
    this.row = new Float64Array(this.columns);
    this.means = new Float64Array(net.depths * this.columns);
    this.counts = new Int32Array(net.depths);
    this.lattice = tileLattice(tile);
  }

  /**
   * Adds row(a, stages) to E.
   * @param {number} a
   * @param {number} stages
   */
  add(a, stages) {
    const { row, tile } = this;
    const { attributes, latents } = this.owner.net;
    const { codebooks } = this.owner.models;
    let at = 0;
    for (const { components, values } of this.fine) {
      for (let c = 0; c < components; c++) row[at++] = values[a * components + c];
    }
    row.fill(0, attributes);
    for (let m = 0; m < stages; m++) {
      const book = codebooks[m === 0 ? 0 : 1];
      if (book === undefined) break;
      const from = tile.index[a * tile.stages + m] * book.dims;
      for (let c = 0; c < latents; c++) row[attributes + c] += book.words[from + c];
    }
    this.known.add(a, row);
  }

  /**
   * `index_inputs`.
   * @param {number} a
   * @param {Int32Array} x (N)
   */
  inputs(a, x) {
    const { tile, means, counts, columns } = this;
    const { net, amax, models } = this.owner;
    this.known.around(a, means, 0, counts, 0);
    x.fill(0, 0, net.classes);
    if (tile.ofClass[a] < net.classes) x[tile.ofClass[a]] = CLASS_INPUT;
    let at = net.classes;
    const append = (/** @type {number} */ v) => {
      x[at++] = clamp(v, -amax, amax);
    };
    if (net.own) {
      for (const { components, values } of this.fine) {
        for (let c = 0; c < components; c++) append(values[a * components + c] >> 6);
      }
    }
    for (let d = 0, row = 0; d < net.depths; d++, row += columns) {
      for (let c = 0; c < net.attributes; c++) append(means[row + c] >> 6);
      for (let c = net.attributes; c < columns; c++) append(roundShift(means[row + c], net.latentShift));
      append(counts[d]);
    }
    if (models.grid !== null) gridFeatures(models.grid, this.lattice.middleOf(a), x, at);
  }
}

/**
 * The embeddings of the anchors of a pass and their recurrent states, which go on from stage to stage. Where they would
 * take too much memory, they are computed anew for each anchor and stage.
 */
class States {
  /**
   * @param {IndexNetwork} owner
   * @param {TileView} view
   * @param {Uint32Array} pass
   * @param {Trace | null} trace
   */
  constructor(owner, view, pass, trace) {
    const { hidden: H, mixed, recurrent, attention, tokens } = owner.net;
    this.owner = owner;
    this.view = view;
    this.pass = pass;
    const history = attention ? tokens + 1 : 0;
    const each = H * (2 + recurrent.length + 2 * history) + mixed;
    this.kept = pass.length * each <= KEPT_NUMBERS;
    const n = this.kept ? pass.length : 1;
    this.h = new Int32Array(n * H);
    this.mixH = new Int32Array(n * mixed);
    this.g = recurrent.map(() => new Int32Array(n * H));
    this.done = new Uint8Array(n);
    this.query = new Int32Array(attention ? n * H : 0);
    /** Keys and values of G_0, G_1, .. (n, T + 1, H). */
    this.keys = new Int32Array(n * history * H);
    this.values = new Int32Array(n * history * H);
    this.history = history;
    this.scores = new Float64Array(history);
    if (!this.kept && trace === null) return;
    for (let p = 0; p < pass.length; p++) {
      const slot = this.#prepare(p);
      trace?.onNumbers("embedding", this.h.slice(slot * H, (slot + 1) * H));
    }
  }

  /**
   * The state of an anchor before its first token.
   * @param {number} p in the pass
   * @returns {number} its slot
   */
  #prepare(p) {
    const { owner } = this;
    const { embed1, embed2, hidden: H, mixed, mixer, recurrent, query } = owner.net;
    const slot = this.kept ? p : 0;
    this.view.inputs(this.pass[p], owner.x);
    applyLinear(embed1, owner.x, 0, 0, owner.amax, owner.embedded, 0);
    applyLinear(embed2, owner.embedded, 0, -owner.amax, owner.amax, this.h, slot * H);
    product(owner.mixH, mixed, H, this.h, slot * H, mixer.biases, this.mixH, slot * mixed);
    recurrent.forEach(({ start }, j) => this.g[j].set(start, slot * H));
    this.done[slot] = 0;
    if (query !== null) {
      applyLinear(query, this.h, slot * H, -SCORE_LIMIT, SCORE_LIMIT, this.query, slot * H);
      this.#remember(slot, 0);
    }
    return slot;
  }

  /**
   * Key and value of G_t, the state of the last recurrent layer.
   * @param {number} slot
   * @param {number} t
   */
  #remember(slot, t) {
    const { key, value, hidden: H } = this.owner.net;
    const g = this.g[this.g.length - 1];
    const to = (slot * this.history + t) * H;
    const { amax } = this.owner;
    applyLinear(/** @type {Linear} */ (key), g, slot * H, -SCORE_LIMIT, SCORE_LIMIT, this.keys, to);
    applyLinear(/** @type {Linear} */ (value), g, slot * H, -amax, amax, this.values, to);
  }

  /**
   * `mixed(h, indices of the stages before)`.
   * @param {number} p in the pass
   * @param {number} stage
   * @param {Int32Array} y (Y)
   */
  mixed(p, stage, y) {
    const { owner } = this;
    const { hidden: H, mixed, mixer, attention } = owner.net;
    const slot = this.kept ? p : this.#prepare(p);
    const { tile } = this.view;
    while (this.done[slot] < stage - 1) {
      const t = ++this.done[slot];
      this.#advance(slot, t, tile.index[this.pass[p] * tile.stages + t - 1]);
      if (attention) this.#remember(slot, t);
    }
    let c = this.g[this.g.length - 1];
    let at = slot * H;
    if (attention) {
      this.#attend(slot, stage);
      [c, at] = [owner.c, 0];
    }
    product(owner.mixC, mixed, H, c, at, owner.noBiases, y, 0);
    const from = slot * mixed;
    for (let r = 0; r < mixed; r++) y[r] = clamp(roundShift(y[r] + this.mixH[from + r], mixer.shift), 0, owner.amax);
  }

  /**
   * Runs the recurrent layers over token t.
   * @param {number} slot
   * @param {number} t from 1
   * @param {number} index of the codeword
   */
  #advance(slot, t, index) {
    const { owner } = this;
    const { recurrent, hidden: H } = owner.net;
    const { px, ph } = owner;
    recurrent.forEach((layer, j) => {
      if (j === 0) {
        const from = owner.fromCodeword[t === 1 ? 0 : 1];
        const bias = (t - 1) * 3 * H;
        for (let i = 0; i < 3 * H; i++) px[i] = from[index * 3 * H + i] + layer.bi[bias + i];
      } else {
        product(layer.wi[0], 3 * H, H, this.g[j - 1], slot * H, layer.bi, px, 0);
      }
      if (t === 1) ph.set(owner.fromStart[j]);
      else product(layer.wh, 3 * H, H, this.g[j], slot * H, layer.bh, ph, 0);
      this.#step(layer.shift, this.g[j], slot * H);
    });
  }

  /**
   * The end of `gru`.
   * @param {number} shift
   * @param {Int32Array} g
   * @param {number} at of the state in g
   */
  #step(shift, g, at) {
    const { px, ph, amax, net } = this.owner;
    const H = net.hidden;
    const toState = 12 - net.activationBits;
    for (let i = 0; i < H; i++) {
      const z = sigmoid12(roundShift(px[i] + ph[i], shift));
      const r = sigmoid12(roundShift(px[H + i] + ph[H + i], shift));
      const past = clamp(roundShift(ph[2 * H + i], shift), -2047, 2047);
      const kept = roundShift(r * past, 12);
      const n = clamp(roundShift(tanh12(roundShift(px[2 * H + i], shift) + kept), toState), -amax, amax);
      g[at + i] = roundShift(z * g[at + i] + (4096 - z) * n, 12);
    }
  }

  /**
   * `attend` over G_0 .. G_(m-1), into `owner.c`.
   * @param {number} slot
   * @param {number} m
   */
  #attend(slot, m) {
    const { c, amax, net } = this.owner;
    const { hidden: H, scoreShift } = net;
    const { query, keys, values, scores } = this;
    const from = slot * this.history * H;
    let most = -Infinity;
    for (let t = 0; t < m; t++) {
      let score = 0;
      for (let i = 0; i < H; i++) score += query[slot * H + i] * keys[from + t * H + i];
      scores[t] = roundShift(score, scoreShift);
      most = Math.max(most, scores[t]);
    }
    let sum = 0;
    for (let t = 0; t < m; t++) sum += scores[t] = exp2w(most - scores[t]);
    for (let t = 0; t < m; t++) scores[t] = Math.floor((256 * scores[t]) / sum);
    for (let i = 0; i < H; i++) {
      let mean = 0;
      for (let t = 0; t < m; t++) mean += scores[t] * values[from + t * H + i];
      c[i] = clamp(roundShift(mean, 8), -amax, amax);
    }
  }
}

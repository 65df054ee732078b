/** Embeddings and recurrent states of the index network (SPEC §10.5, `mixed`, `gru`, `attend`). */

import { applyLinear, clamp, exp2w, product, roundShift, sigmoid12, tanh12 } from "./integers.js";

/**
 * @typedef {import("./index_network.js").IndexNetwork} IndexNetwork
 * @typedef {import("./integers.js").Linear} Linear
 * @typedef {import("./network_inputs.js").NetworkInputs} NetworkInputs
 * @typedef {import("./trace.js").Trace} Trace
 */

const SCORE_LIMIT = 127;
/** States of a pass are kept from stage to stage up to so many numbers. */
const KEPT_NUMBERS = 2 ** 25;

/**
 * The embeddings of the anchors of a pass and their recurrent states, which go on from stage to stage. Where they would
 * take too much memory, they are computed anew for each anchor and stage.
 */
export class NetworkStates {
  /**
   * @param {IndexNetwork} owner
   * @param {NetworkInputs} view
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

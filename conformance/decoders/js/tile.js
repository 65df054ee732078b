/** A tile: its anchors and their integers, decoded layer by layer (SPEC §7). */

import { findDepths, fine, mergeByCode } from "./cells.js";
import { readChannel, readOffsets } from "./channels.js";
import { BLOCK, PROFILE, STREAM } from "./constants.js";
import { blockBytes, checkBlock, findBlock } from "./container.js";
import { demand } from "./errors.js";
import { Groups } from "./groups.js";
import { readIndices } from "./indices.js";
import { NO_SOURCE } from "./layer_block.js";
import { readPositions } from "./positions.js";
import { allowedStreams, readTileBlock } from "./tile_block.js";

/**
 * @typedef {import("./cells.js").Depth} Depth
 * @typedef {import("./container.js").Container} Container
 * @typedef {import("./index_network.js").IndexNetwork} IndexNetwork
 * @typedef {import("./models.js").Models} Models
 * @typedef {import("./tile_block.js").SubStreams} SubStreams
 * @typedef {import("./trace.js").Trace} Trace
 */

/** Stages that a class has at most. @param {Models} models */
const mostStages = ({ rows, layers }) => Math.max(...rows[layers].stages);

/** @param {Int32Array} old @param {number} length @returns {Int32Array} with zeros at the end */
function grown(old, length) {
  const longer = new Int32Array(length);
  longer.set(old);
  return longer;
}

export class Tile {
  /**
   * @param {Container} container
   * @param {Models} models
   * @param {number} number of the tile; -1 for one without a place, that never has anchors
   */
  constructor(container, models, number) {
    const { header, tiles } = container;
    this.container = container;
    this.models = models;
    this.number = number;
    this.slots = header.slots;
    this.anchorProfile = header.profile === PROFILE.ANCHOR;
    this.depth = tiles.depth[number] ?? 0;
    this.shift = tiles.shift[number] ?? 0;
    this.prefix = tiles.prefix[number] ?? 0n;
    this.bits = header.lattice_bits - this.depth - this.shift;
    /** The last layer decoded. */
    this.layer = 0;
    this.stages = mostStages(models);
    this.size = 0;
    /** Local codes (n). */
    this.codes = { high: new Uint32Array(0), low: new Uint32Array(0) };
    /** Classes (n). */
    this.ofClass = new Uint8Array(0);
    /** Layer that turned each slot on, 0 if none (n, slots); none in the explicit profile. */
    this.slotLayer = new Uint8Array(0);
    /** Integers of each channel (n, components), of OFFSETS (n, slots, 3). @type {Int32Array[]} */
    this.v = models.channels.map(() => new Int32Array(0));
    /** First-step values of the channels that context rules look at (n, components). @type {(Int32Array | null)[]} */
    this.first = models.channels.map((_, i) => (isSource(models, i) ? new Int32Array(0) : null));
    /** Indices (n, stages). */
    this.index = new Uint16Array(0);
    /** Anchors by code, then index. @type {Uint32Array} */
    this.byCode = new Uint32Array(0);
    /** @type {Depth[] | null} */
    this.depthsOfLayer = null;
    /** @type {Map<number, Int32Array>} */
    this.fineOfLayer = new Map();
  }

  /** DECODER_MLP, null where no layer decoded holds one (R-9.2-3). */
  get decoder() {
    const { decoder, decoderLayer } = this.models;
    return decoderLayer <= this.layer ? decoder : null;
  }

  /**
   * Takes models of more layers, with which the layers after this one are decoded. Integers are kept.
   * @param {Models} models of the same file
   */
  extend(models) {
    const stages = mostStages(models);
    const index = new Uint16Array(this.size * stages);
    for (let a = 0; a < this.size; a++) {
      index.set(this.index.subarray(a * this.stages, (a + 1) * this.stages), a * stages);
    }
    this.models = models;
    this.stages = stages;
    this.index = index;
  }

  /** Bytes that its integers take. */
  get bytes() {
    const { codes, ofClass, slotLayer, v, first, index, byCode } = this;
    const arrays = [codes.high, codes.low, ofClass, slotLayer, ...v, ...first, index, byCode];
    return arrays.reduce((sum, array) => sum + (array?.byteLength ?? 0), 0);
  }

  /**
   * `decode_tile_layer` of the layer after the last one, with the checks of the block, §12.2 step 8.
   * @param {number} k
   * @param {IndexNetwork | null} network
   * @param {Trace | null} trace
   */
  decodeLayer(k, network, trace) {
    const { models } = this;
    this.layer = k;
    const e = findBlock(this.container, k, BLOCK.TILE, this.number);
    const appear = e < 0 ? 0 : this.container.entries.count[e];
    const streams = e < 0 ? new Map() : this.#readBlock(e, appear > 0);
    if (this.size === 0 && appear === 0 && streams.size === 0) return;
    const within = (/** @type {number} */ stream, /** @type {(groups: Groups) => void} */ read) => {
      const groups = new Groups(stream, streams.get(stream), models.tables[k - 1], trace);
      read(groups);
      groups.seal();
    };
    this.#forgetContext();
    if (appear > 0) {
      within(STREAM.POSITIONS, (groups) => this.#append(readPositions(groups, appear, this.bits), appear));
      within(STREAM.CLASSES, (groups) => this.#readClasses(k, groups, appear));
    }
    if (this.anchorProfile) within(STREAM.MASKS, (groups) => this.#readMasks(k, groups));
    models.channels.forEach(({ stream }, i) => {
      if (stream === STREAM.OFFSETS) within(stream, (groups) => readOffsets(this, k, i, groups));
      else within(stream, (groups) => readChannel(this, k, i, groups, trace));
      if (stream === STREAM.POSITION_RESIDUAL) this.#checkResiduals(k, i);
    });
    within(STREAM.INDICES, (groups) => {
      if (models.rows[k].entropy_mode === 0) readIndices(this, k, groups, trace);
      else /** @type {IndexNetwork} */ (network).readIndices(this, k, groups, trace);
    });
    this.#forgetContext();
  }

  /** What is derived from the integers of one layer. */
  #forgetContext() {
    this.depthsOfLayer = null;
    this.fineOfLayer.clear();
  }

  /**
   * @param {number} e
   * @param {boolean} appears
   * @returns {SubStreams}
   */
  #readBlock(e, appears) {
    checkBlock(this.container, e);
    const channels = this.models.channels.map(({ stream }) => stream);
    const allowed = allowedStreams(this.container.header.profile, channels, appears);
    return readTileBlock(blockBytes(this.container, e), this.container.entries.offset[e], allowed);
  }

  /**
   * Appends anchors whose values are all 0.
   * @param {import("./positions.js").Codes} codes
   * @param {number} appear
   */
  #append(codes, appear) {
    const { channels } = this.models;
    const size = this.size + appear;
    const joined = (/** @type {Uint32Array} */ old, /** @type {Uint32Array} */ added) => {
      const both = new Uint32Array(size);
      both.set(old);
      both.set(added, this.size);
      return both;
    };
    this.codes = { high: joined(this.codes.high, codes.high), low: joined(this.codes.low, codes.low) };
    this.byCode = mergeByCode(this.codes, this.byCode);
    const bytes = (/** @type {Uint8Array} */ old, /** @type {number} */ width) => {
      const longer = new Uint8Array(size * width);
      longer.set(old);
      return longer;
    };
    this.ofClass = bytes(this.ofClass, 1);
    this.slotLayer = bytes(this.slotLayer, this.anchorProfile ? this.slots : 0);
    channels.forEach(({ stream, components }, i) => {
      this.v[i] = grown(this.v[i], size * components * (stream === STREAM.OFFSETS ? this.slots : 1));
      const first = this.first[i];
      if (first !== null) this.first[i] = grown(first, size * components);
    });
    const index = new Uint16Array(size * this.stages);
    index.set(this.index);
    this.index = index;
    this.size = size;
  }

  /**
   * §7.3.
   * @param {number} k
   * @param {Groups} groups
   * @param {number} appear
   */
  #readClasses(k, groups, appear) {
    const first = this.models.rows[k - 1].classes;
    const past = this.models.rows[k].classes;
    demand(past > first, "bad-class", `anchors appear in layer ${k}, which has no new class`);
    const at = this.size - appear;
    if (past - first === 1) {
      this.ofClass.fill(first, at);
      return;
    }
    const values = groups.read(0, 0, 0, appear);
    for (let i = 0; i < appear; i++) {
      const fits = values[i] >= 0 && values[i] < past - first;
      demand(fits, "bad-class", `class ${first + values[i]}`);
      this.ofClass[at + i] = first + values[i];
    }
  }

  /**
   * §7.4.
   * @param {number} k
   * @param {Groups} groups
   */
  #readMasks(k, groups) {
    const { size, slots, slotLayer } = this;
    const on = new Uint8Array(size);
    for (let i = 0; i < slotLayer.length; i++) if (slotLayer[i] !== 0) on[Math.floor(i / slots)]++;
    const bits = new Int32Array(size);
    for (let s = 0; s < slots; s++) {
      const anchors = Uint32Array.from({ length: size }, (_, a) => a).filter((a) => slotLayer[a * slots + s] === 0);
      const contexts = Uint8Array.from(anchors, (a) => on[a]);
      groups.readByContext(0, 0, contexts, anchors.length, bits);
      for (let i = 0; i < anchors.length; i++) {
        demand(bits[i] === 0 || bits[i] === 1, "bad-mask", `mask symbol ${bits[i]}`);
      }
      for (let i = 0; i < anchors.length; i++) {
        if (bits[i] === 0) continue;
        slotLayer[anchors[i] * slots + s] = k;
        on[anchors[i]]++;
      }
    }
  }

  /**
   * R-7.5-3.
   * @param {number} k
   * @param {number} i
   */
  #checkResiduals(k, i) {
    const weights = this.stepWeights(k, i);
    const v = this.v[i];
    for (let a = 0, at = 0; a < this.size; a++) {
      for (let j = 0; j < 3; j++, at++) {
        const r = v[at] * weights[this.ofClass[a] * 3 + j];
        demand(r >= -1 && r <= 1, "value-range", `a position residual of ${r}`);
      }
    }
  }

  /**
   * w(n) of §9 of each class and component of channel i after layer k.
   * @param {number} k
   * @param {number} i
   * @returns {Float64Array} (classes, components)
   */
  stepWeights(k, i) {
    const { rules } = this.models.channels[i];
    const steps = this.models.rows[k].steps[i];
    return Float64Array.from({ length: steps.length * rules.length }, (_, at) => {
      const n = steps[Math.floor(at / rules.length)];
      return n === 0 ? 0 : rules[at % rules.length].first_width / 3 ** (n - 1);
    });
  }

  /**
   * @param {(ofClass: number) => boolean} holds
   * @returns {Uint32Array} the anchors of such classes, ascending
   */
  select(holds) {
    if (this.size === 0) return new Uint32Array(0);
    const wanted = Array.from({ length: this.models.rows[this.models.layers].classes }, (_, c) => holds(c));
    if (!wanted.includes(true)) return new Uint32Array(0);
    const anchors = new Uint32Array(this.size);
    let n = 0;
    for (let a = 0; a < this.size; a++) if (wanted[this.ofClass[a]]) anchors[n++] = a;
    return anchors.subarray(0, n);
  }

  /** @param {Uint32Array} anchors @returns {Uint32Array} the same by code, then index */
  inCodeOrder(anchors) {
    const chosen = new Uint8Array(this.size);
    for (const a of anchors) chosen[a] = 1;
    return this.byCode.filter((a) => chosen[a] === 1);
  }

  /** Depths of the occupancy targets in this layer. @returns {Depth[]} */
  depths() {
    this.depthsOfLayer ??= findDepths(this.codes, this.byCode, this.models.context.targets, this.bits);
    return this.depthsOfLayer;
  }

  /**
   * Fine values of a channel that has been read in layer k.
   * @param {number} k
   * @param {number} i
   * @returns {Int32Array} (n, components)
   */
  fineAfter(k, i) {
    let values = this.fineOfLayer.get(i);
    if (values === undefined) {
      const steps = this.models.rows[k].steps[i];
      const { components } = this.models.channels[i];
      const v = this.v[i];
      values = new Int32Array(v.length);
      for (let at = 0; at < v.length; at++) {
        values[at] = fine(v[at], steps[this.ofClass[Math.floor(at / components)]]);
      }
      this.fineOfLayer.set(i, values);
    }
    return values;
  }
}

/**
 * Whether a context rule looks at the first values of channel i.
 * @param {Models} models
 * @param {number} i
 */
function isSource({ channels }, i) {
  return channels.some(({ rules }) => rules.some((rule) => rule.source_channel === i && i !== NO_SOURCE));
}

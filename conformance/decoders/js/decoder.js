/**
 * A decoder of .scar files, all of SPEC.md 0.2.
 *
 *     const scar = openScar(bytes);
 *     const { position, values } = scar.decode({ layers: 1 });
 *
 * What is wrong with a file is thrown as `Refused`, whose `id` is one of SPEC §12.1.
 */

import { activateAnchors, activateGaussians } from "./activate.js";
import { BLOCK, DEFAULT_LIMITS, PROFILE, STREAM, STREAM_NAMES } from "./constants.js";
import { readContainer } from "./container.js";
import { Refused } from "./errors.js";
import { IndexNetwork } from "./index_network.js";
import { readMetadata } from "./metadata.js";
import { readModels } from "./models.js";
import { channelValues, codewordSums, latents, positions } from "./reconstruct.js";
import { memorySource } from "./source.js";
import { readStreaming } from "./streaming.js";
import { Tile } from "./tile.js";

export { Refused, DEFAULT_LIMITS };

/**
 * @typedef {import("./constants.js").Limits} Limits
 * @typedef {import("./container.js").Container} Container
 * @typedef {import("./models.js").Models} Models
 * @typedef {import("./source.js").Source} Source
 * @typedef {import("./trace.js").Trace} Trace
 * @typedef {import("./activate.js").Exact} Exact
 */

/**
 * @param {Uint8Array | Source} input
 * @param {{limits?: Partial<Limits>, allowTruncated?: boolean}} [options] allowTruncated: accept a file that is cut
 *   short, of which only whole layers can be decoded (R-5.3-8)
 * @returns {Scar} after the rules of §5
 */
export function openScar(input, { limits = {}, allowTruncated = false } = {}) {
  const source = input instanceof Uint8Array ? memorySource(input) : input;
  const all = { ...DEFAULT_LIMITS, ...limits };
  return new Scar(readContainer(source, all, allowTruncated), all);
}

export class Scar {
  /**
   * @param {Container} container
   * @param {Limits} limits
   */
  constructor(container, limits) {
    this.container = container;
    this.limits = limits;
  }

  get header() {
    return this.container.header;
  }

  /** Layers that arrived whole. */
  get layersArrived() {
    const { layers, source } = this.container;
    return layers.filter(({ end_offset }) => end_offset <= source.length).length;
  }

  /** @returns {object | null} */
  metadata() {
    return readMetadata(this.container, this.limits)?.value ?? null;
  }

  /** What tells a client which tiles and layers to fetch first; null where the file says nothing of it. */
  streaming() {
    return readStreaming(this.container);
  }

  /**
   * The models of layers 1..k, checked.
   * @param {number} [layers] k; 0 for all
   * @returns {Models}
   */
  models(layers = 0) {
    const k = layers === 0 ? this.header.layer_count : layers;
    if (!Number.isInteger(k) || k < 1 || k > this.header.layer_count) throw new RangeError(`no layer ${layers}`);
    if (k > this.layersArrived) throw new Refused("truncated-block", `layer ${k} is cut`, this.container.source.length);
    return readModels(this.container, k);
  }

  /**
   * Tiles one after the other, so that a scene need not be in memory at once.
   * @param {{layers?: number, tiles?: Iterable<number>, models?: Models, trace?: Trace | null}} [options] layers: 0 for
   *   all; tiles: all where it is left out
   * @returns {Generator<Tile>}
   */
  *tiles({ layers = 0, tiles, models = this.models(layers), trace = null } = {}) {
    const network = models.network === null ? null : new IndexNetwork(models);
    for (const number of tiles ?? this.container.tiles.depth.keys()) {
      if (!(number >= 0 && number < this.header.tile_count)) throw new RangeError(`no tile ${number}`);
      const tile = new Tile(this.container, models, number);
      for (let k = 1; k <= models.layers; k++) tile.decodeLayer(k, network, k === models.layers ? trace : null);
      yield tile;
    }
  }

  /**
   * A tile without anchors, after all layers of some models.
   * @param {Models} models
   * @returns {Tile}
   */
  emptyTile(models) {
    const tile = new Tile(this.container, models, -1);
    tile.layer = models.layers;
    return tile;
  }

  /**
   * Exact values of a tile, §9.1 and §9.2.
   * @param {Tile} tile
   * @returns {Exact & {sums: Int32Array | null}}
   */
  exactValues(tile) {
    const { channels } = tile.models;
    const sums = tile.decoder === null ? null : codewordSums(tile);
    /** @type {Map<number, Float32Array>} */
    const values = new Map();
    channels.forEach(({ stream }, i) => {
      if (stream !== STREAM.POSITION_RESIDUAL) values.set(stream, channelValues(tile, i));
    });
    return { position: positions(tile, this.header), values, sums, latent: sums === null ? null : latents(tile, sums) };
  }

  /**
   * Activated values of a tile, §9.3 to §9.6.
   * @param {Tile} tile
   * @param {Exact} exact
   * @param {number[]} [eye] camera centre, anchor profile
   */
  activatedValues(tile, exact, eye = this.header.origin) {
    if (this.header.profile === PROFILE.EXPLICIT) return activateGaussians(tile, this.header, exact);
    const { feature, ...gaussian } = activateAnchors(tile, exact, eye);
    return {
      feature,
      ...Object.fromEntries(Object.entries(gaussian).map(([name, array]) => [`gaussian.${name}`, array])),
    };
  }

  /**
   * All tiles, or some, in the order of §6.3.
   * @param {{layers?: number, tiles?: readonly number[], activated?: boolean}} [options]
   * @returns {{anchors: number, position: Float64Array, class: Uint8Array, values: Record<string, Float32Array>,
   *   latent?: Float32Array, activated?: Record<string, Float64Array>}}
   */
  decode({ layers = 0, tiles, activated = false } = {}) {
    /** @type {Map<string, any[]>} */
    const parts = new Map();
    const add = (/** @type {string} */ name, /** @type {any} */ array) => {
      const list = parts.get(name);
      if (list === undefined) parts.set(name, [array]);
      else list.push(array);
    };
    this.#checkGathered(layers, tiles);
    let anchors = 0;
    for (const tile of this.tiles({ layers, tiles })) {
      anchors += tile.size;
      const exact = this.exactValues(tile);
      add("position", exact.position);
      add("class", tile.ofClass);
      for (const [stream, values] of exact.values) add(`values/${STREAM_NAMES[stream]}`, values);
      if (exact.latent !== null) add("latent", exact.latent);
      if (!activated) continue;
      for (const [name, values] of Object.entries(this.activatedValues(tile, exact))) add(`activated/${name}`, values);
    }
    /** @type {any} */
    const out = { anchors, position: new Float64Array(0), class: new Uint8Array(0), values: {} };
    for (const [path, list] of parts) {
      const [group, name] = path.split("/");
      if (name === undefined) out[group] = concatenate(list);
      else (out[group] ??= {})[name] = concatenate(list);
    }
    return out;
  }

  /** R-13.2-3. @param {number} layers 0 for all @param {readonly number[]} [tiles] all where it is left out */
  #checkGathered(layers, tiles) {
    const last = layers === 0 ? this.header.layer_count : layers;
    const chosen = tiles === undefined ? null : new Set(tiles);
    const { kind, layer, tile, count } = this.container.entries;
    const anchors = count.reduce((sum, appear, e) => {
      const isHeld = kind[e] === BLOCK.TILE && layer[e] <= last && (chosen?.has(tile[e]) ?? true);
      return isHeld ? sum + appear : sum;
    }, 0);
    const { gathered, gathered_slots: slots } = this.limits;
    if (anchors <= gathered && anchors * this.header.slots <= slots) return;
    const advice = "take some tiles, fewer layers, or tile by tile with tiles()";
    throw new Refused("limit-gathered", `${anchors} anchors at once: ${advice}`);
  }
}

/**
 * @template {Float64Array | Float32Array | Uint8Array} T
 * @param {T[]} parts at least one
 * @returns {T}
 */
function concatenate(parts) {
  const Type = /** @type {new (length: number) => T} */ (parts[0].constructor);
  const whole = new Type(parts.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of parts) {
    whole.set(part, at);
    at += part.length;
  }
  return whole;
}

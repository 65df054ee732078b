/** The inputs of the index network (SPEC §10.5, `index_inputs`). */

import { Surroundings } from "./cells.js";
import { gridFeatures } from "./grid.js";
import { activationLimit, clamp, roundShift } from "./integers.js";
import { tileLattice } from "./lattice.js";
import { isAttribute } from "./predictors.js";

/**
 * @typedef {import("./models.js").Models} Models
 * @typedef {import("./network_block.js").Network} Network
 * @typedef {import("./tile.js").Tile} Tile
 */

const CLASS_INPUT = 64;

/** What the network sees of a tile in one layer: the inputs of an anchor. */
export class NetworkInputs {
  /**
   * @param {Network} net
   * @param {Models} models
   * @param {Tile} tile
   * @param {number} k
   */
  constructor(net, models, tile, k) {
    this.net = net;
    this.models = models;
    this.tile = tile;
    this.amax = activationLimit(net.activationBits);
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
    const { attributes, latents } = this.net;
    const { codebooks } = this.models;
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
    const { net, models, tile, amax, means, counts, columns } = this;
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

/** Exact values of the anchors of a tile (SPEC §9.1, §9.2). */

import { STREAM } from "./constants.js";
import { tileLattice } from "./lattice.js";

/**
 * @typedef {import("./header.js").Header} Header
 * @typedef {import("./tile.js").Tile} Tile
 */

/**
 * §9.1.
 * @param {Tile} tile
 * @param {Header} header
 * @returns {Float64Array} (n, 3)
 */
export function positions(tile, header) {
  const lattice = tileLattice(tile);
  const { corner, step } = lattice;
  const channel = tile.models.channels.findIndex(({ stream }) => stream === STREAM.POSITION_RESIDUAL);
  const weights = channel < 0 ? null : tile.stepWeights(tile.layer, channel);
  const out = new Float64Array(tile.size * 3);
  for (let a = 0, at = 0; a < tile.size; a++) {
    const cell = lattice.cellOf(a);
    for (let axis = 0; axis < 3; axis++, at++) {
      let t = corner[axis] + cell[axis] * step + step / 2;
      if (weights !== null) t += step * (tile.v[channel][at] * weights[tile.ofClass[a] * 3 + axis]);
      out[at] = header.origin[axis] + header.voxel * t;
    }
  }
  return out;
}

/**
 * §9.2.
 * @param {Tile} tile
 * @param {number} i channel
 * @returns {Float32Array} (n, components), of OFFSETS (n, slots, 3)
 */
export function channelValues(tile, i) {
  const { stream, components, rules } = tile.models.channels[i];
  const v = tile.v[i];
  const out = new Float32Array(v.length);
  if (stream === STREAM.OFFSETS) {
    for (let at = 0; at < v.length; at++) out[at] = v[at] * rules[at % components].first_width;
    return out;
  }
  const weights = tile.stepWeights(tile.layer, i);
  for (let a = 0, at = 0; a < tile.size; a++) {
    const row = tile.ofClass[a] * components;
    for (let j = 0; j < components; j++, at++) out[at] = v[at] * weights[row + j];
  }
  return out;
}

/**
 * S of R-9.2-2.
 * @param {Tile} tile
 * @returns {Int32Array} (n, d)
 */
export function codewordSums(tile) {
  const { codebooks, dims, rows } = tile.models;
  const { stages } = rows[tile.layer];
  const out = new Int32Array(tile.size * dims);
  for (let a = 0; a < tile.size; a++) {
    for (let m = 0; m < stages[tile.ofClass[a]]; m++) {
      const words = codebooks[m === 0 ? 0 : 1]?.words ?? new Int32Array(0);
      const from = tile.index[a * tile.stages + m] * dims;
      for (let d = 0; d < dims; d++) out[a * dims + d] += words[from + d];
    }
  }
  return out;
}

/**
 * z of R-9.2-2.
 * @param {Tile} tile
 * @param {Int32Array} sums
 * @returns {Float32Array} (n, d)
 */
export function latents(tile, sums) {
  const out = Float32Array.from(sums);
  const channel = tile.models.channels.findIndex(({ stream }) => stream === STREAM.LATENT);
  if (channel < 0) return out;
  // The sum of two f32 in f64, rounded to f32, is their f32 sum.
  channelValues(tile, channel).forEach((value, at) => {
    out[at] += value;
  });
  return out;
}

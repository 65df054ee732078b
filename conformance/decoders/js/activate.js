/** Activated values in doubles (SPEC §9.3 to §9.6). */

import { STREAM } from "./constants.js";
import { applyMlp, mlpInputs, mlpOutputs } from "./mlp.js";

/**
 * @typedef {import("./header.js").Header} Header
 * @typedef {import("./mlp.js").Mlp} Mlp
 * @typedef {import("./tile.js").Tile} Tile
 * What §9.1 and §9.2 give of a tile: values by stream kind.
 * @typedef {{position: Float64Array, values: Map<number, Float32Array>, latent: Float32Array | null}} Exact
 */

const LARGEST_LOG_OPACITY = -(2 ** -13);

/**
 * §9.3.
 * @param {ArrayLike<number>} values of ROTATION
 * @param {number} at of (u, v, twist)
 * @param {Float64Array} out
 * @param {number} to where (w, x, y, z) go
 */
function rotation(values, at, out, to) {
  const u = values[at];
  const v = values[at + 1];
  let x = (u + v) / 2;
  let y = (u - v) / 2;
  let z = 1 - Math.abs(u + v) / 2 - Math.abs(u - v) / 2;
  const length = Math.sqrt(x * x + y * y + z * z);
  [x, y, z] = [x / length, y / length, z / length];
  const c = Math.cos(values[at + 2] / 2);
  const s = Math.sin(values[at + 2] / 2);
  const l = Math.sqrt((1 + z) * (1 + z) + x * x + y * y) * (c < 0 ? -1 : 1);
  out[to] = ((1 + z) * c) / l;
  out[to + 1] = (x * s - y * c) / l;
  out[to + 2] = (x * c + y * s) / l;
  out[to + 3] = ((1 + z) * s) / l;
}

/**
 * Activated values of the explicit profile.
 * @param {Tile} tile
 * @param {Header} header
 * @param {Exact} exact
 * @returns {{rotation: Float64Array, logit: Float64Array, opacity: Float64Array, sh: Float64Array}}
 *   (n, 4), (n), (n), (n, (degree + 1)², 3)
 */
export function activateGaussians(tile, header, { values, latent }) {
  const n = tile.size;
  const out = { rotation: new Float64Array(4 * n), logit: new Float64Array(n), opacity: new Float64Array(n) };
  const rotations = values.get(STREAM.ROTATION) ?? new Float32Array(3 * n);
  const opacities = values.get(STREAM.OPACITY) ?? new Float32Array(n);
  for (let a = 0; a < n; a++) {
    rotation(rotations, 3 * a, out.rotation, 4 * a);
    const y = Math.min(opacities[a], LARGEST_LOG_OPACITY);
    out.logit[a] = y - Math.log(-Math.expm1(y));
    out.opacity[a] = 1 / (1 + Math.exp(-out.logit[a]));
  }
  return { ...out, sh: harmonics(tile, header, values.get(STREAM.COLOUR), latent) };
}

/**
 * §9.4.
 * @param {Tile} tile
 * @param {Header} header
 * @param {Float32Array | undefined} colours (n, 3) Y, G, O
 * @param {Float32Array | null} latent (n, d)
 * @returns {Float64Array} (n, (degree + 1)², 3)
 */
function harmonics(tile, header, colours, latent) {
  const n = tile.size;
  const width = 3 * (header.sh_degree + 1) ** 2;
  const sh = new Float64Array(n * width);
  const { dims } = tile.models;
  const { decoder } = tile;
  for (let a = 0; a < n; a++) {
    const at = a * width;
    if (colours !== undefined) {
      const [Y, G, O] = colours.subarray(3 * a, 3 * a + 3);
      sh[at] = Y - G + O;
      sh[at + 1] = Y + G;
      sh[at + 2] = Y - G - O;
    }
    if (decoder === null || latent === null) continue;
    const z = Float64Array.from(latent.subarray(a * dims, (a + 1) * dims));
    sh.set(applyMlp(decoder, z), at + (colours === undefined ? 0 : 3));
  }
  return sh;
}

const sigmoid = (/** @type {number} */ x) => 1 / (1 + Math.exp(-x));

/**
 * Activated values of the anchor profile for a camera centre, of every slot, on or off.
 * @param {Tile} tile
 * @param {Exact} exact
 * @param {number[]} eye
 * @returns {{feature: Float64Array, opacity: Float64Array, scale: Float64Array, rotation: Float64Array,
 *   colour: Float64Array, centre: Float64Array}} (n, D); (n, K), (n, K, 3), (n, K, 4), (n, K, 3), (n, K, 3)
 */
export function activateAnchors(tile, { position, values, latent }, eye) {
  const { decoder, dims, scene } = tile.models;
  const n = tile.size;
  const K = tile.slots;
  if (decoder === null || latent === null) throw new Error("the anchor profile has a DECODER_MLP");
  const D = mlpOutputs(decoder);
  const scales = /** @type {Float32Array} */ (values.get(STREAM.SCALE));
  const offsets = /** @type {Float32Array} */ (values.get(STREAM.OFFSETS));
  const out = {
    feature: new Float64Array(n * D),
    opacity: new Float64Array(n * K),
    scale: new Float64Array(n * K * 3),
    rotation: new Float64Array(n * K * 4),
    colour: new Float64Array(n * K * 3),
    centre: new Float64Array(n * K * 3),
  };
  const input = new Float64Array(mlpInputs(scene[0]));
  for (let a = 0; a < n; a++) {
    const feature = applyMlp(decoder, Float64Array.from(latent.subarray(a * dims, (a + 1) * dims)));
    out.feature.set(feature, a * D);
    const centre = position.subarray(3 * a, 3 * a + 3);
    input.set(feature);
    lookAt(centre, eye, input, D);
    const [opacity, covariance, colour] = scene.map((network) => applyMlp(network, input));
    const s = scales.subarray(6 * a, 6 * a + 6);
    for (let k = 0; k < K; k++) {
      const slot = a * K + k;
      out.opacity[slot] = Math.tanh(opacity[k]);
      for (let i = 0; i < 3; i++) {
        out.scale[3 * slot + i] = Math.exp(s[3 + i]) * sigmoid(covariance[7 * k + i]);
        out.colour[3 * slot + i] = sigmoid(colour[3 * k + i]);
        out.centre[3 * slot + i] = centre[i] + offsets[3 * slot + i] * Math.exp(s[i]);
      }
      normalise(covariance.subarray(7 * k + 3, 7 * k + 7), out.rotation.subarray(4 * slot, 4 * slot + 4));
    }
  }
  return out;
}

/**
 * (v, d), or v alone where there is no room for d. Divided by the largest number first: no square over- or underflows.
 * @param {Float64Array} centre (3)
 * @param {number[]} eye (3)
 * @param {Float64Array} out
 * @param {number} to
 */
function lookAt(centre, eye, out, to) {
  const v = [0, 1, 2].map((i) => centre[i] - eye[i]);
  const most = Math.max(...v.map(Math.abs));
  const [x, y, z] = v.map((number) => (most === 0 ? 0 : number / most));
  const length = Math.sqrt(x * x + y * y + z * z);
  [x, y, z].forEach((number, i) => (out[to + i] = most === 0 ? 0 : number / length));
  if (to + 3 < out.length) out[to + 3] = length * most;
}

/**
 * @param {Float64Array} q (4)
 * @param {Float64Array} out (4)
 */
function normalise(q, out) {
  const length = Math.hypot(...q);
  if (length === 0) out[0] = 1;
  else for (let i = 0; i < 4; i++) out[i] = q[i] / length;
}

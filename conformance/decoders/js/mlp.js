/** DECODER_MLP and SCENE_MLP blocks (SPEC §7.9), and their networks in doubles (§9.5). */

import { Reader } from "./bytes.js";
import { decompress } from "./zstd.js";

/**
 * y = weights x + biases, then max(y, 0) between layers.
 * @typedef {{rows: number, columns: number, weights: Float64Array, biases: Float64Array}} MlpLayer
 *   weights: (rows, columns), already times the scale of their row
 * @typedef {MlpLayer[]} Mlp
 */

const MAX_CONTENT = 16 * 2 ** 20;

/**
 * The block with §5.8 and R-7.9-1.
 * @param {Uint8Array} block
 * @returns {Mlp[]}
 */
export function readNetworks(block) {
  const reader = new Reader(decompress(block, MAX_CONTENT));
  const networks = Array.from({ length: reader.count(8) }, () => readNetwork(reader));
  reader.end();
  return networks;
}

/** @param {Reader} reader @returns {Mlp} */
function readNetwork(reader) {
  const count = reader.count(4);
  reader.demand(count >= 1, "bad-mlp", "a network without layers");
  /** @type {Mlp} */
  const layers = [];
  for (let i = 0; i < count; i++) layers.push(readLayer(reader, i === 0 ? null : layers[i - 1].rows));
  return layers;
}

/**
 * @param {Reader} reader
 * @param {number | null} inputs outputs of the layer before
 * @returns {MlpLayer}
 */
function readLayer(reader, inputs) {
  const rows = reader.count(1024);
  reader.demand(rows >= 1, "bad-mlp", "a layer without outputs");
  const columns = reader.count(1024);
  reader.demand(columns >= 1 && (inputs ?? columns) === columns, "bad-mlp", `${columns} inputs`);
  const width = reader.u8();
  reader.demand(width === 1 || width === 2, "bad-mlp", `weights of ${width} bytes`);
  const start = reader.skip(rows * columns * width);
  const scales = readFinite(reader, rows);
  const biases = readFinite(reader, rows);
  const weights = Float64Array.from({ length: rows * columns }, (_, i) => {
    const weight = width === 1 ? reader.view.getInt8(start + i) : reader.view.getInt16(start + 2 * i, true);
    return weight * scales[Math.floor(i / columns)];
  });
  return { rows, columns, weights, biases };
}

/**
 * @param {Reader} reader
 * @param {number} n
 * @returns {Float64Array}
 */
function readFinite(reader, n) {
  const numbers = Float64Array.from({ length: n }, () => reader.f32());
  reader.demand(numbers.every(Number.isFinite), "bad-mlp", "a scale or bias that is not finite");
  return numbers;
}

/** @param {Mlp} network */
export const mlpInputs = (network) => network[0].columns;

/** @param {Mlp} network */
export const mlpOutputs = (network) => network[network.length - 1].rows;

/**
 * @param {Mlp} network
 * @param {Float64Array} x (inputs)
 * @returns {Float64Array} (outputs)
 */
export function applyMlp(network, x) {
  let vector = x;
  network.forEach(({ rows, columns, weights, biases }, i) => {
    const y = new Float64Array(rows);
    for (let r = 0, w = 0; r < rows; r++) {
      let sum = 0;
      for (let c = 0; c < columns; c++) sum += weights[w++] * vector[c];
      sum += biases[r];
      y[r] = i + 1 < network.length ? Math.max(sum, 0) : sum;
    }
    vector = y;
  });
  return vector;
}

/** ENTROPY_NETWORK blocks (SPEC §10.5): reading and checking. */

import { Reader } from "./bytes.js";
import { demand } from "./errors.js";
import {
  ACCUMULATOR_LIMIT,
  activationLimit,
  clamp,
  keepsReach,
  linearFits,
  MAX_SHIFT,
  readLinear,
  readWeights,
  roundShift,
} from "./integers.js";
import { readShifted } from "./rice.js";

/**
 * @typedef {import("./codebooks.js").Codebook} Codebook
 * @typedef {import("./integers.js").Linear} Linear
 * @typedef {{shift: number, inputs: number, wi: Int32Array[], wh: Int32Array, bi: Int32Array, bh: Int32Array,
 *   start: Int32Array}} Recurrent
 *   wi: one (3H, inputs) a head in the first layer, else one; bi: (T, 3H) in the first layer, else (3H)
 * @typedef {{size: number, clusters: number[], project1: Linear, project2: Linear | null, shift: number,
 *   memberShift: number, clusterBiases: Int32Array, biases: Int32Array}} Head
 * @typedef {{activationBits: number, own: boolean, attention: boolean, latentShift: number, codewordShift: number,
 *   classes: number, attributes: number, depths: number, latents: number, grid: number, codewordDims: number,
 *   embedWidth: number, hidden: number, mixed: number, inputs: number, tokens: number, embed1: Linear,
 *   embed2: Linear, recurrent: Recurrent[], query: Linear | null, key: Linear | null, value: Linear | null,
 *   scoreShift: number, mixer: Linear, heads: Head[]}} Network
 */

const MAX_INPUTS = 512;
const RECURRENT_LIMIT = 2 ** 23;

/**
 * The block with R-10.5-1.
 * @param {Uint8Array} bytes
 * @param {number} offset in the file
 * @returns {Network}
 */
export function readNetwork(bytes, offset) {
  const reader = new Reader(bytes, offset);
  const linear = (/** @type {number} */ rows, /** @type {number} */ columns) =>
    readLinear(reader, rows, columns, "bad-network");
  const activationBits = reader.u8();
  const flags = reader.u8();
  const [latentShift, codewordShift] = [reader.u8(), reader.u8()];
  const [classes, attributes, depths, latents, grid] = Array.from({ length: 5 }, () => reader.count(512));
  const codewordDims = reader.count(64);
  const [embedWidth, hidden, mixed] = Array.from({ length: 3 }, () => reader.count(256));
  const [layers, tokens, headCount] = [reader.count(4), reader.count(7), reader.count(2)];
  const own = (flags & 1) !== 0;
  const attention = (flags & 2) !== 0;
  const inputs = classes + (own ? attributes : 0) + depths * (attributes + latents + 1) + grid;
  reader.demand(flags <= 3 && inputs <= MAX_INPUTS, "bad-network", `flags ${flags}, ${inputs} inputs`);
  const embed1 = linear(embedWidth, inputs);
  const embed2 = linear(hidden, embedWidth);
  const recurrent = Array.from({ length: layers }, (_, g) =>
    g === 0
      ? readRecurrent(reader, hidden, codewordDims + 1, headCount, tokens)
      : readRecurrent(reader, hidden, hidden, 1, 1),
  );
  const query = attention ? linear(hidden, hidden) : null;
  const key = attention ? linear(hidden, hidden) : null;
  const value = attention ? linear(hidden, hidden) : null;
  const scoreShift = attention ? reader.u8() : 0;
  const mixer = linear(mixed, 2 * hidden);
  const heads = Array.from({ length: headCount }, () => readHead(reader, codewordDims + 1, mixed));
  reader.end();
  return {
    activationBits,
    own,
    attention,
    latentShift,
    codewordShift,
    classes,
    attributes,
    depths,
    latents,
    grid,
    codewordDims,
    embedWidth,
    hidden,
    mixed,
    inputs,
    tokens,
    embed1,
    embed2,
    recurrent,
    query,
    key,
    value,
    scoreShift,
    mixer,
    heads,
  };
}

/**
 * @param {Reader} reader
 * @param {number} hidden
 * @param {number} inputs
 * @param {number} matrices of Wi
 * @param {number} biasRows of bi
 * @returns {Recurrent}
 */
function readRecurrent(reader, hidden, inputs, matrices, biasRows) {
  const shift = reader.u8();
  const wi = Array.from({ length: matrices }, () => readWeights(reader, 3 * hidden * inputs, "bad-network"));
  const wh = readWeights(reader, 3 * hidden * hidden, "bad-network");
  const bi = readShifted(reader, biasRows * 3 * hidden);
  const bh = readShifted(reader, 3 * hidden);
  return { shift, inputs, wi, wh, bi, bh, start: readShifted(reader, hidden) };
}

/**
 * @param {Reader} reader
 * @param {number} dims R + 1
 * @param {number} mixed
 * @returns {Head}
 */
function readHead(reader, dims, mixed) {
  const size = reader.count(4096);
  const clusterCount = reader.count(256);
  const clusters = Array.from({ length: clusterCount }, () => reader.count(4096));
  const project1 = readLinear(reader, dims, mixed, "bad-network");
  const project2 = clusterCount > 0 ? readLinear(reader, dims, mixed, "bad-network") : null;
  const shift = reader.u8();
  const memberShift = reader.u8();
  const clusterBiases = readShifted(reader, clusterCount);
  return { size, clusters, project1, project2, shift, memberShift, clusterBiases, biases: readShifted(reader, size) };
}

/** @param {boolean} holds @param {string} what */
function bad(holds, what) {
  demand(holds, "bad-network", what);
}

/** R-10.5-2 to R-10.5-5. @param {Network} net */
export function checkNetwork(net) {
  bad(net.activationBits >= 8 && net.activationBits <= 12, `${net.activationBits} activation bits`);
  const amax = activationLimit(net.activationBits);
  const widths = [net.inputs, net.codewordDims, net.embedWidth, net.hidden, net.mixed];
  widths.push(net.recurrent.length, net.heads.length);
  bad(
    widths.every((width) => width >= 1),
    "a width of 0",
  );
  bad(net.classes <= 15, `${net.classes} class columns`);
  const shifts = [net.latentShift, net.codewordShift, net.scoreShift];
  shifts.push(...net.recurrent.map(({ shift }) => shift));
  shifts.push(...net.heads.flatMap(({ shift, memberShift }) => [shift, memberShift]));
  bad(
    shifts.every((shift) => shift <= MAX_SHIFT),
    "a shift above 24",
  );
  const linears = [net.embed1, net.embed2, net.query, net.key, net.value, net.mixer];
  linears.push(...net.heads.flatMap(({ project1, project2 }) => [project1, project2]));
  for (const layer of linears) bad(layer === null || linearFits(layer, amax), "a linear layer");
  net.recurrent.forEach((layer) => checkRecurrent(layer, net.hidden, amax));
  bad(net.tokens === 0 || net.heads.length === 2, "tokens without a second head");
  for (const { size, clusters, memberShift } of net.heads) {
    bad(size >= 1, "a head of no codewords");
    const sum = clusters.reduce((a, b) => a + b, 0);
    const fits = clusters.length > 0 ? sum === size && clusters.every((n) => n >= 1) : memberShift === 0;
    bad(fits, "clusters of a head");
  }
}

/**
 * R-10.5-3.
 * @param {Recurrent} layer
 * @param {number} hidden
 * @param {number} amax
 */
function checkRecurrent({ shift, inputs, wi, wh, bi, bh, start }, hidden, amax) {
  bad(
    start.every((n) => Math.abs(n) <= amax),
    "a start that is no activation",
  );
  const largest = new Float64Array(3 * hidden);
  bi.forEach((bias, i) => {
    largest[i % largest.length] = Math.max(largest[i % largest.length], Math.abs(bias));
  });
  for (const matrix of wi) bad(keepsReach(matrix, inputs, largest, shift, amax, RECURRENT_LIMIT), "sums of Wi");
  bad(keepsReach(wh, hidden, bh, shift, amax, RECURRENT_LIMIT), "sums of Wh");
}

/**
 * R-10.5-6 but for the codebooks.
 * @param {Network} net
 * @param {{attributes: number, depths: number, grid: number, dims: number, stages: number}} file
 *   stages: the most of any class in the layers decoded
 */
export function checkNetworkFits(net, file) {
  bad(net.attributes === file.attributes && net.depths === file.depths, "attributes or depths");
  bad(net.grid === file.grid, `${net.grid} features of the grid, not ${file.grid}`);
  bad(net.codewordDims <= file.dims && net.latents <= file.dims, "dimensions of the latent");
  bad(net.tokens + 1 >= file.stages, `${net.tokens} tokens for ${file.stages} stages`);
}

/**
 * The codewords of a head as activations, §10.5.
 * @typedef {{e: Int32Array, centroids: Int32Array, deviations: Int32Array, starts: number[]}} Vectors
 *   e, deviations: (size, R + 1); centroids: (clusters, R + 1); starts: first codeword of each cluster, and size
 */

/**
 * @param {Network} net
 * @param {number} h head
 * @param {Codebook | undefined} book
 * @returns {Vectors} with the rest of R-10.5-6, and R-10.5-7
 */
export function makeVectors(net, h, book) {
  const head = net.heads[h];
  if (book === undefined || head === undefined || head.size !== book.size) bad(false, `no head for codebook ${h}`);
  const { words, dims, size } = /** @type {Codebook} */ (book);
  const amax = activationLimit(net.activationBits);
  const R = net.codewordDims;
  const e = new Int32Array(size * (R + 1));
  for (let k = 0; k < size; k++) {
    let squares = 0;
    for (let i = 0; i < R; i++) {
      const x = clamp(roundShift(words[k * dims + i], net.codewordShift), -amax, amax);
      e[k * (R + 1) + i] = x;
      squares += x * x;
    }
    e[k * (R + 1) + R] = Math.min(8 * (32 - Math.clz32(squares)), amax);
  }
  const vectors = { e, ...clusterVectors(e, R + 1, head.clusters) };
  checkVectors(head, vectors, R + 1, amax);
  return vectors;
}

/**
 * @param {Int32Array} e (size, width)
 * @param {number} width
 * @param {number[]} clusters
 */
function clusterVectors(e, width, clusters) {
  const centroids = new Int32Array(clusters.length * width);
  const deviations = new Int32Array(clusters.length > 0 ? e.length : 0);
  const starts = [0];
  clusters.forEach((n, i) => {
    const first = starts[i];
    starts.push(first + n);
    for (let d = 0; d < width; d++) {
      let sum = 0;
      for (let k = first; k < first + n; k++) sum += e[k * width + d];
      const centroid = Math.floor(sum / n);
      centroids[i * width + d] = centroid;
      for (let k = first; k < first + n; k++) deviations[k * width + d] = e[k * width + d] - centroid;
    }
  });
  return { centroids, deviations, starts };
}

/**
 * R-10.5-7.
 * @param {Head} head
 * @param {Vectors} vectors
 * @param {number} width
 * @param {number} amax
 */
function checkVectors(head, { e, centroids, deviations }, width, amax) {
  const fits = (/** @type {Int32Array} */ vectors, /** @type {Int32Array} */ biases, /** @type {number} */ shift) =>
    bad(keepsReach(vectors, width, biases, shift, amax, ACCUMULATOR_LIMIT), "sums of a logit");
  if (head.clusters.length === 0) {
    fits(e, head.biases, head.shift);
  } else {
    fits(centroids, head.clusterBiases, head.shift);
    fits(deviations, head.biases, head.memberShift);
  }
}

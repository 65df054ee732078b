/** PREDICTORS blocks and what a predictor computes (SPEC §10.3). */

import { Reader } from "./bytes.js";
import { STREAM } from "./constants.js";
import { demand } from "./errors.js";
import { activationLimit, clamp, keepsReach, MAX_SHIFT, product, readWeights, roundShift } from "./integers.js";
import { readShifted } from "./rice.js";

/**
 * @typedef {import("./layer_block.js").Channel} Channel
 * @typedef {import("./layer_block.js").Row} Row
 * Weights of the class columns (rows, 15) and of the others (rows, columns), whose first column is that after them.
 * @typedef {{rows: number, columns: number, ofClass: Int32Array, weights: Int32Array, biases: Int32Array,
 *   shift: number}} PredictorLayer
 * @typedef {{stream: number, component: number, step: number, b1: number, b2: number, classes: number,
 *   inputs: number, units: number}} Head
 */

export const CLASS_COLUMNS = 15;
const CLASS_INPUT = 64;
const AMAX = activationLimit(10);

/** Attribute channels, §10.2. */
export const ATTRIBUTES = Object.freeze([STREAM.SCALE, STREAM.ROTATION, STREAM.OPACITY, STREAM.COLOUR]);

/** @param {number} stream */
export const isAttribute = (stream) => ATTRIBUTES.includes(/** @type {any} */ (stream));

/** Predicted channels, §10.3. @param {number} stream */
const isPredicted = (stream) => isAttribute(stream) || stream === STREAM.LATENT;

export class Predictor {
  /**
   * @param {Head} head
   * @param {PredictorLayer | null} hidden
   * @param {PredictorLayer} output
   */
  constructor(head, hidden, output) {
    this.head = head;
    this.hidden = hidden;
    this.output = output;
    this.start = new Int32Array(Math.max(head.units, 2));
    this.outputs = new Int32Array(2);
    /** Inputs after the class columns, then hidden units: the caller fills the inputs. */
    this.x = new Int32Array(head.inputs - CLASS_COLUMNS + head.units);
  }

  /**
   * The context number of `x`.
   * @param {number} ofClass class of the anchor
   * @returns {number} 0..255
   */
  context(ofClass) {
    const { hidden, output, x, outputs } = this;
    const { b1, b2, units } = this.head;
    if (hidden !== null) {
      const at = hidden.columns;
      product(hidden.weights, units, at, x, 0, this.#biases(hidden, ofClass), x, at);
      for (let i = at; i < at + units; i++) x[i] = clamp(roundShift(x[i], hidden.shift), 0, AMAX);
    }
    product(output.weights, 2, output.columns, x, 0, this.#biases(output, ofClass), outputs, 0);
    const o0 = roundShift(outputs[0], output.shift);
    const o1 = roundShift(outputs[1], output.shift);
    return clamp(o0, 0, b1 - 1) * b2 + clamp(o1, 0, b2 - 1);
  }

  /**
   * Biases with what the class columns add.
   * @param {PredictorLayer} layer
   * @param {number} ofClass
   */
  #biases({ rows, biases, ofClass: weights }, ofClass) {
    for (let r = 0; r < rows; r++) this.start[r] = biases[r] + CLASS_INPUT * weights[r * CLASS_COLUMNS + ofClass];
    return this.start;
  }
}

/**
 * The block with R-10.3-1 and R-10.3-2.
 * @param {Uint8Array} bytes
 * @param {number} offset in the file
 * @returns {Predictor[]}
 */
export function readPredictors(bytes, offset) {
  const reader = new Reader(bytes, offset);
  const count = reader.count(1024);
  reader.demand(count >= 1, "bad-predictor", "no predictor");
  const predictors = Array.from({ length: count }, () => readPredictor(reader));
  reader.end();
  return predictors;
}

/** @param {Reader} reader @returns {Predictor} */
function readPredictor(reader) {
  const [stream, component, step, b1, b2, classes, inputs, units] = Array.from({ length: 8 }, () => reader.u8());
  const head = { stream, component, step, b1: b1 + 1, b2: b2 + 1, classes, inputs, units };
  const sound = isPredicted(stream) && classes <= CLASS_COLUMNS && inputs > CLASS_COLUMNS && units <= 64;
  reader.demand(sound, "bad-predictor", "the head of a predictor");
  const hidden = units > 0 ? readLayer(reader, units, inputs, classes) : null;
  const output = readLayer(reader, 2, inputs + units, classes);
  for (const layer of hidden === null ? [output] : [hidden, output]) {
    reader.demand(layerFits(layer), "bad-predictor", "shift or sums of a layer");
  }
  reader.demand(step >= 1 && head.b1 * head.b2 <= 256, "bad-predictor", "step or contexts of a predictor");
  return new Predictor(head, hidden, output);
}

/**
 * @param {Reader} reader
 * @param {number} rows
 * @param {number} columns with the class columns
 * @param {number} classes
 * @returns {PredictorLayer}
 */
function readLayer(reader, rows, columns, classes) {
  const shift = reader.u8();
  const others = columns - CLASS_COLUMNS;
  const stored = readWeights(reader, rows * (others + classes), "bad-predictor");
  const biases = readShifted(reader, rows);
  const ofClass = new Int32Array(rows * CLASS_COLUMNS);
  const weights = new Int32Array(rows * others);
  for (let r = 0; r < rows; r++) {
    const row = stored.subarray(r * (others + classes), (r + 1) * (others + classes));
    ofClass.set(row.subarray(0, classes), r * CLASS_COLUMNS);
    weights.set(row.subarray(classes), r * others);
  }
  return { rows, columns: others, ofClass, weights, biases, shift };
}

/** R-10.1-1 with the class columns. @param {PredictorLayer} layer */
function layerFits({ rows, columns, ofClass, weights, biases, shift }) {
  const classSums = Array.from(biases, (bias, r) => {
    const row = ofClass.subarray(r * CLASS_COLUMNS, (r + 1) * CLASS_COLUMNS);
    return Math.abs(bias) + AMAX * row.reduce((sum, weight) => sum + Math.abs(weight), 0);
  });
  return rows >= 1 && shift <= MAX_SHIFT && keepsReach(weights, columns, classSums, shift, AMAX);
}

/**
 * R-10.3-3.
 * @param {Predictor[]} predictors of the block of the last of `rows`
 * @param {Channel[]} channels
 * @param {Row[]} rows of the layers up to that of the block
 * @param {number} depths
 */
export function checkPredictors(predictors, channels, rows, depths) {
  let before = -1;
  for (const { head } of predictors) {
    const bad = (/** @type {boolean} */ holds, /** @type {string} */ what) =>
      demand(holds, "bad-predictor", `predictor of ${head.stream}, ${head.component}, ${head.step}: ${what}`);
    const key = (head.stream * 256 + head.component) * 256 + head.step;
    bad(key > before, "keys do not ascend");
    before = key;
    const i = channels.findIndex(({ stream }) => stream === head.stream);
    bad(i >= 0 && head.component < channels[i].components, "no such component");
    const first = rows.findIndex(({ steps }) => steps[i].some((n) => n >= head.step));
    bad(first === rows.length - 1, "the step does not first travel in this layer");
    const own = channels[i].components;
    const attributes = channels.slice(0, i).filter(({ stream }) => isAttribute(stream));
    const seen = attributes.reduce((sum, { components }) => sum + components, own);
    const wanted = CLASS_COLUMNS + seen + depths * (own + 2);
    bad(head.inputs === wanted, `${head.inputs} inputs, not ${wanted}`);
  }
}

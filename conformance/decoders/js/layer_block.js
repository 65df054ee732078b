/** LAYER blocks: channel table, decoded context, one row of the layer table each (SPEC §6.4, §6.5, §7.11). */

import { MAX_CLASSES, MAX_STAGES, MAX_STEPS, PROFILE, STREAM } from "./constants.js";
import { demand, Refused } from "./errors.js";
import { Reader } from "./bytes.js";

/**
 * The context rule of a component, §8.4.
 * @typedef {{first_width: number, by_class: number, source_channel: number, source_component: number, shift: number,
 *   low: number}} Rule
 * @typedef {{stream: number, components: number, rules: Rule[]}} Channel
 * @typedef {{passes_log2: number, targets: number[]}} DecodedContext §10.2
 * @typedef {{entropy_mode: number, classes: number, stages: Uint8Array, steps: Uint8Array[]}} Row
 *   classes that have appeared; stages per class (15, 0 for classes not yet there), steps per channel and class
 */

export const NO_SOURCE = 255;

const CHANNELS = Object.freeze([
  STREAM.POSITION_RESIDUAL,
  STREAM.SCALE,
  STREAM.ROTATION,
  STREAM.OPACITY,
  STREAM.COLOUR,
  STREAM.LATENT,
  STREAM.OFFSETS,
]);

/** Components of each stream kind by profile, §6.4; 0 where LATENT has any number. @type {Map<number, number>[]} */
const COMPONENTS = [
  new Map([
    [STREAM.POSITION_RESIDUAL, 3],
    [STREAM.SCALE, 3],
    [STREAM.ROTATION, 3],
    [STREAM.OPACITY, 1],
    [STREAM.COLOUR, 3],
    [STREAM.LATENT, 0],
  ]),
  new Map([
    [STREAM.POSITION_RESIDUAL, 3],
    [STREAM.SCALE, 6],
    [STREAM.LATENT, 0],
    [STREAM.OFFSETS, 3],
  ]),
];
const NEEDED = [[STREAM.SCALE], [STREAM.SCALE, STREAM.OFFSETS]];

/** The row before layer 1. @param {number} channels @returns {Row} */
export function emptyRow(channels) {
  return {
    entropy_mode: 0,
    classes: 0,
    stages: new Uint8Array(MAX_CLASSES),
    steps: Array.from({ length: channels }, () => new Uint8Array(MAX_CLASSES)),
  };
}

/**
 * The LAYER block of layer 1.
 * @param {Uint8Array} bytes
 * @param {number} offset in the file
 * @returns {{channels: Channel[], context: DecodedContext, row: Row}}
 */
export function readFirstLayer(bytes, offset) {
  const reader = new Reader(bytes, offset);
  const mode = readMode(reader);
  const channels = Array.from({ length: reader.count(8) }, () => readChannel(reader));
  const passes_log2 = reader.u8();
  const targets = Array.from({ length: reader.count(4) }, () => reader.varint(16));
  return { channels, context: { passes_log2, targets }, row: readRow(reader, mode, channels.length) };
}

/**
 * The LAYER block of a later layer.
 * @param {Uint8Array} bytes
 * @param {number} offset in the file
 * @param {number} channels
 * @returns {Row}
 */
export function readLaterLayer(bytes, offset, channels) {
  const reader = new Reader(bytes, offset);
  return readRow(reader, readMode(reader), channels);
}

/** @param {Reader} reader */
function readMode(reader) {
  const mode = reader.u8();
  reader.demand(mode <= 1, "unsupported-entropy-mode", `entropy mode ${mode}`);
  return mode;
}

/** @param {Reader} reader @returns {Channel} */
function readChannel(reader) {
  const stream = reader.u8();
  reader.demand(CHANNELS.includes(/** @type {any} */ (stream)), "bad-channel", `stream kind ${stream}`);
  const components = reader.u8();
  reader.demand(components >= 1 && components <= 64, "bad-channel", `${components} components`);
  const rules = Array.from({ length: components }, () => {
    const first_width = reader.f64();
    const by_class = reader.u8();
    reader.demand(by_class <= 1, "bad-channel", `by_class ${by_class}`);
    const source_channel = reader.u8();
    const source_component = reader.u8();
    const shift = reader.u8();
    return { first_width, by_class, source_channel, source_component, shift, low: reader.svarint(33) };
  });
  return { stream, components, rules };
}

/**
 * @param {Reader} reader
 * @param {number} mode
 * @param {number} channels
 * @returns {Row}
 */
function readRow(reader, mode, channels) {
  const row = { ...emptyRow(channels), entropy_mode: mode, classes: reader.count(MAX_CLASSES) };
  for (let c = 0; c < row.classes; c++) {
    row.stages[c] = reader.u8();
    for (const steps of row.steps) steps[c] = reader.u8();
  }
  reader.end();
  return row;
}

/**
 * R-6.4-1 to R-6.4-3 and R-8.4-1.
 * @param {Channel[]} channels
 * @param {number} profile
 */
export function checkChannels(channels, profile) {
  const bad = (/** @type {boolean} */ holds, /** @type {string} */ message) => demand(holds, "bad-channel", message);
  const allowed = COMPONENTS[profile];
  channels.forEach(({ stream, components, rules }, i) => {
    bad(i === 0 || channels[i - 1].stream < stream, "channels do not ascend");
    const wanted = allowed.get(stream);
    bad(wanted !== undefined, `stream kind ${stream} is not of the profile`);
    bad(wanted === 0 || wanted === components, `${components} components of stream kind ${stream}`);
    for (const { first_width: w } of rules) bad(w > 0 && w <= 2 ** 96, `first width ${w}`);
    rules.forEach((rule, j) => bad(ruleFits(channels, i, j, rule), `context rule of component ${j} of channel ${i}`));
  });
  for (const needed of NEEDED[profile]) {
    bad(
      channels.some(({ stream }) => stream === needed),
      `no channel of stream kind ${needed}`,
    );
  }
}

/**
 * R-8.4-1.
 * @param {Channel[]} channels
 * @param {number} i
 * @param {number} j
 * @param {Rule} rule
 */
function ruleFits(channels, i, j, rule) {
  if (rule.source_channel === NO_SOURCE) return rule.source_component === 0 && rule.shift === 0 && rule.low === 0;
  const source = channels[rule.source_channel];
  if (source === undefined || rule.source_component >= source.components || rule.shift > 31) return false;
  const earlier = rule.source_channel < i || (rule.source_channel === i && rule.source_component < j);
  return earlier && channels[i].stream !== STREAM.OFFSETS && source.stream !== STREAM.OFFSETS;
}

/** R-10.2-1. @param {DecodedContext} context */
export function checkContext({ passes_log2, targets }) {
  const fits = passes_log2 <= 3 && targets.every((target, i) => target >= 1 && (i === 0 || target < targets[i - 1]));
  demand(fits, "bad-context", `passes ${passes_log2}, targets ${targets}`);
}

/**
 * R-6.5-2, R-10.4-1, R-6.5-3, R-6.5-4.
 * @param {Row[]} rows of layers 1..k
 * @param {Channel[]} channels
 * @param {number} profile
 */
export function checkLayerTable(rows, channels, profile) {
  const bad = (/** @type {string} */ message) => {
    throw new Refused("bad-layer-table", message);
  };
  let before = emptyRow(channels.length);
  rows.forEach((row, i) => {
    if (row.classes < 1 || row.classes < before.classes) bad(`${row.classes} classes in layer ${i + 1}`);
    const keeps = (/** @type {Uint8Array} */ now, /** @type {Uint8Array} */ old, /** @type {number} */ most) =>
      now.every((n, c) => n >= old[c] && n <= most);
    if (!keeps(row.stages, before.stages, MAX_STAGES)) bad(`stages of layer ${i + 1}`);
    if (!row.steps.every((n, c) => keeps(n, before.steps[c], MAX_STEPS))) bad(`steps of layer ${i + 1}`);
    if (row.entropy_mode === 1 && !row.stages.some((n) => n > 0)) bad(`entropy mode 1 without stages, layer ${i + 1}`);
    before = row;
  });
  const offsets = channels.findIndex(({ stream }) => stream === STREAM.OFFSETS);
  for (const row of rows) {
    if (offsets >= 0 && !row.steps[offsets].subarray(0, row.classes).every((n) => n === 1)) bad("steps of OFFSETS");
  }
  if (profile === PROFILE.ANCHOR && !needsDecoder(rows[0], channels)) bad("layer 1 has no features");
}

/**
 * Whether a class has a stage or a step of LATENT.
 * @param {Row} row
 * @param {Channel[]} channels
 */
export function needsDecoder(row, channels) {
  const latent = channels.findIndex(({ stream }) => stream === STREAM.LATENT);
  return row.stages.some((n) => n > 0) || (latent >= 0 && row.steps[latent].some((n) => n > 0));
}

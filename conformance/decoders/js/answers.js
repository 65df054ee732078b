/** Answers to the questions of the decoder protocol (PROTOCOL.md). */

import { NamedArrays } from "./arrays.js";
import { PROFILE, STREAM, STREAM_NAMES } from "./constants.js";
import { openScar, Refused } from "./decoder.js";
import { gridFeatures } from "./grid.js";
import { tileLattice } from "./lattice.js";
import { readMetadata } from "./metadata.js";
import { mlpOutputs } from "./mlp.js";
import { readStreaming } from "./streaming.js";
import { Trace } from "./trace.js";

/**
 * @typedef {import("./arrays.js").Numbers} Numbers
 * @typedef {import("./decoder.js").Scar} Scar
 * @typedef {import("./models.js").Models} Models
 * @typedef {import("./source.js").Source} Source
 * @typedef {import("./tile.js").Tile} Tile
 * @typedef {Map<string, NamedArrays>} StageArrays arrays of each stage asked for
 */

/** Stages of the answer to `all`. */
const DECODED = [
  "container",
  "models",
  "context",
  "frequencies",
  "indices",
  "integers",
  "sums",
  "values",
  "activated",
];
const BEFORE_TILES = ["container", "models"];

export const CAPABILITIES = Object.freeze({
  protocol: "scar-conformance 2",
  decoder: "scar-decoder-js 0.2.0",
  versions: ["0.2"],
  profiles: ["explicit", "anchor"],
  stages: [...DECODED, "metadata", "streaming"],
});

/**
 * Whose answers are given: how it opens a file, and the stages that `all` asks for.
 * @typedef {{open: (source: Source) => Scar, decoded: string[]}} Answering
 */

/** @type {Answering} */
const THIS_DECODER = { open: openScar, decoded: DECODED };

/**
 * The answer to a question, in pieces of one line of JSON. What is thrown is a failure, not an answer.
 * @param {Source} source
 * @param {{layers: number, stage: string, camera?: number[]}} question camera: origin of the header without it
 * @param {Answering} [decoder]
 * @returns {Iterable<string>}
 */
export function answer(source, { layers, stage, camera }, { open, decoded } = THIS_DECODER) {
  try {
    const scar = open(source);
    if (stage === "metadata") return metadataAnswer(scar);
    if (stage === "streaming") return [JSON.stringify({ stages: { streaming: { streaming: streamingFields(scar) } } })];
    const stages = stage === "all" ? decoded : [stage];
    if (!stages.every((name) => decoded.includes(name))) throw new RangeError(`no stage ${stage}`);
    return stagesJson(scar, stages, decodeStages(scar, stages, layers, camera));
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    return [JSON.stringify({ refused: error.id, offset: error.offset, message: error.message })];
  }
}

/**
 * The text of the file is repeated, since numbers may be beyond what JSON.parse keeps.
 * @param {Scar} scar
 * @returns {string[]}
 */
function metadataAnswer(scar) {
  const text = readMetadata(scar.container, scar.limits)?.text ?? "null";
  return [`{"stages": {"metadata": {"metadata": ${text.replaceAll(/[\r\n]/g, " ")}}}}`];
}

/** What the file tells clients, null where it tells nothing. @param {Scar} scar */
function streamingFields(scar) {
  const streaming = readStreaming(scar.container);
  if (streaming === null) return null;
  const { layers, tiles, view, viewpoints, low, high, reach, gains } = streaming;
  const seen = viewpoints.length / 3;
  return {
    layers,
    view: view === null ? null : Array.from(view, bitsOfSingle),
    viewpoints: rows(Array.from(viewpoints, bitsOfSingle), 3, seen),
    low: rows(Array.from(low), 3, tiles),
    high: rows(Array.from(high), 3, tiles),
    reach: Array.from(reach),
    gains: rows(rows(Array.from(gains), tiles, seen * layers), layers, seen),
  };
}

/**
 * Lists of `width` items, `count` of them.
 * @template T
 * @param {T[]} items
 * @param {number} width
 * @param {number} count
 */
function rows(items, width, count) {
  return Array.from({ length: count }, (_, row) => items.slice(row * width, (row + 1) * width));
}

/**
 * @param {Scar} scar
 * @param {string[]} stages
 * @param {StageArrays} arrays
 * @returns {Generator<string>}
 */
function* stagesJson(scar, stages, arrays) {
  let separator = '{"stages": {';
  for (const stage of stages) {
    yield `${separator}"${stage}": `;
    if (stage === "container") yield* containerJson(scar);
    else yield* /** @type {NamedArrays} */ (arrays.get(stage)).json();
    separator = ", ";
  }
  yield "}}";
}

/**
 * @param {Scar} scar
 * @param {string[]} stages
 * @param {number} layers
 * @param {number[]} [camera]
 * @returns {StageArrays}
 */
function decodeStages(scar, stages, layers, camera) {
  /** @type {StageArrays} */
  const arrays = new Map(stages.map((stage) => [stage, new NamedArrays(stage === "activated")]));
  if (stages.every((stage) => stage === "container")) return arrays;
  const models = scar.models(layers);
  const at = (/** @type {string} */ stage) => arrays.get(stage) ?? null;
  addModels(models, at("models"));
  if (stages.every((stage) => BEFORE_TILES.includes(stage))) return arrays;
  const context = at("context");
  const hidden = models.network?.hidden ?? 0;
  const trace = new Trace((name, values) => context?.add(name, "<i4", name === "embedding" ? [hidden] : [], values));
  // Every array is declared by a tile of no anchors, for files without tiles.
  for (const tile of withEmpty(scar, models, trace)) {
    addContext(tile, at("context"));
    addIndices(tile, at("indices"));
    addIntegers(tile, at("integers"));
    addValues(scar, tile, at("sums"), at("values"), at("activated"), camera);
  }
  for (const [name, numbers] of trace.frequencies) at("frequencies")?.add(`frequencies.${name}`, "<u4", [], numbers);
  return arrays;
}

/**
 * A tile without anchors, by which every array is declared, then the tiles of the file.
 * @param {Scar} scar
 * @param {Models} models
 * @param {Trace} trace
 * @returns {Generator<Tile>}
 */
function* withEmpty(scar, models, trace) {
  yield scar.emptyTile(models);
  yield* scar.tiles({ models, trace });
}

/** @param {Models} models @param {NamedArrays | null} out */
function addModels({ codebooks, grid }, out) {
  for (const book of codebooks) {
    if (book !== undefined) out?.add(`codebook.${book.number}`, "<i4", [book.dims], book.words);
  }
  grid?.levels.forEach(({ features, bits }, i) => out?.add(`grid.bits.${i}`, "|u1", [features], bits));
}

/** @param {Tile} tile @param {NamedArrays | null} out */
function addContext(tile, out) {
  const { grid } = tile.models;
  if (out === null || grid === null) return;
  const lattice = tileLattice(tile);
  const features = new Int32Array(tile.size * grid.features);
  for (let a = 0; a < tile.size; a++) gridFeatures(grid, lattice.middleOf(a), features, a * grid.features);
  out.add("grid.features", "<i4", [grid.features], features);
}

/** @param {Tile} tile @param {NamedArrays | null} out */
function addIndices(tile, out) {
  out?.add("index", "<u2", [tile.stages], tile.index, tile.size);
}

/** @param {Tile} tile @param {NamedArrays | null} out */
function addIntegers(tile, out) {
  if (out === null) return;
  const codes = new Uint32Array(2 * tile.size);
  for (let a = 0; a < tile.size; a++) {
    codes[2 * a] = tile.codes.low[a];
    codes[2 * a + 1] = tile.codes.high[a];
  }
  out.add("tile", "<u4", [], new Uint32Array(tile.size).fill(tile.number));
  out.add("code", "<u8", [], codes);
  out.add("class", "|u1", [], tile.ofClass);
  if (tile.anchorProfile) out.add("slot_layer", "|u1", [tile.slots], tile.slotLayer);
  tile.models.channels.forEach(({ stream }, i) => {
    out.add(`v.${STREAM_NAMES[stream]}`, "<i4", channelRow(tile, i), tile.v[i]);
  });
}

/** Shape of a channel without the first dimension. @param {Tile} tile @param {number} i */
function channelRow(tile, i) {
  const { stream, components } = tile.models.channels[i];
  return stream === STREAM.OFFSETS ? [tile.slots, components] : [components];
}

/**
 * @param {Scar} scar
 * @param {Tile} tile
 * @param {NamedArrays | null} sums
 * @param {NamedArrays | null} values
 * @param {NamedArrays | null} activated
 * @param {number[]} [camera]
 */
function addValues(scar, tile, sums, values, activated, camera) {
  if (sums === null && values === null && activated === null) return;
  const exact = scar.exactValues(tile);
  const { dims, channels } = tile.models;
  if (exact.sums !== null) sums?.add("codeword_sum", "<i4", [dims], exact.sums);
  values?.add("position", "<f8", [3], exact.position);
  channels.forEach(({ stream }, i) => {
    const numbers = exact.values.get(stream);
    if (numbers !== undefined) values?.add(`value.${STREAM_NAMES[stream]}`, "<f4", channelRow(tile, i), numbers);
  });
  if (exact.latent !== null) values?.add("latent", "<f4", [dims], exact.latent);
  if (activated === null) return;
  const rows = activatedRows(scar, tile.models);
  for (const [name, numbers] of Object.entries(scar.activatedValues(tile, exact, camera))) {
    activated.add(name, "<f8", rows[name], numbers);
  }
}

/**
 * Shapes of the activated arrays without the first dimension.
 * @param {Scar} scar
 * @param {Models} models
 * @returns {Record<string, number[]>}
 */
function activatedRows({ header }, { decoder }) {
  const { profile, sh_degree, slots } = header;
  if (profile === PROFILE.EXPLICIT) return { rotation: [4], logit: [], opacity: [], sh: [(sh_degree + 1) ** 2, 3] };
  return {
    feature: [decoder === null ? 0 : mlpOutputs(decoder)],
    "gaussian.opacity": [slots],
    "gaussian.scale": [slots, 3],
    "gaussian.rotation": [slots, 4],
    "gaussian.colour": [slots, 3],
    "gaussian.centre": [slots, 3],
  };
}

/**
 * @param {number} number f64
 * @returns {string} its bits, most significant first
 */
function bitsOf(number) {
  const view = new DataView(new ArrayBuffer(8));
  view.setFloat64(0, number);
  return view.getBigUint64(0).toString(16).padStart(16, "0");
}

/**
 * @param {number} number f32
 * @returns {string} its bits, most significant first
 */
function bitsOfSingle(number) {
  const view = new DataView(new ArrayBuffer(4));
  view.setFloat32(0, number);
  return view.getUint32(0).toString(16).padStart(8, "0");
}

/** The fields of the tables of §5. @param {Scar} scar @returns {Generator<string>} */
function* containerJson({ container: { header, layers, tiles, entries } }) {
  const hex = Array.from(header.signature, (byte) => byte.toString(16).padStart(2, "0")).join("");
  const special = { signature: hex, origin: header.origin.map(bitsOf), voxel: bitsOf(header.voxel) };
  yield `{"container": {"header": ${JSON.stringify({ ...strings(header), ...special })}, "layers": `;
  yield JSON.stringify(layers.map(strings));
  yield ', "tiles": ';
  yield* recordsJson(tiles);
  yield ', "entries": ';
  yield* recordsJson(entries);
  yield "}}";
}

/** Integers as strings. @param {object} record @returns {Record<string, unknown>} */
function strings(record) {
  const text = (/** @type {unknown} */ value) => (Array.isArray(value) ? value.map(String) : String(value));
  return Object.fromEntries(Object.entries(record).map(([name, value]) => [name, text(value)]));
}

/**
 * A list of records that are held as one array a field.
 * @param {Record<string, ArrayLike<number | bigint>>} columns
 * @returns {Generator<string>}
 */
function* recordsJson(columns) {
  const names = Object.keys(columns);
  const n = columns[names[0]].length;
  yield "[";
  for (let i = 0; i < n; i++) {
    const record = Object.fromEntries(names.map((name) => [name, String(columns[name][i])]));
    yield (i === 0 ? "" : ", ") + JSON.stringify(record);
  }
  yield "]";
}

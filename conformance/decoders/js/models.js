/** The model blocks of layers 1..k, read and checked in the order of SPEC §12.2, steps 3 to 7. */

import { readCodebooks } from "./codebooks.js";
import { BLOCK, PROFILE, STREAM } from "./constants.js";
import { blockBytes, checkBlock, findBlock } from "./container.js";
import { demand, Refused } from "./errors.js";
import { readGrid } from "./grid.js";
import {
  checkChannels,
  checkContext,
  checkLayerTable,
  emptyRow,
  needsDecoder,
  readFirstLayer,
  readLaterLayer,
} from "./layer_block.js";
import { mlpInputs, mlpOutputs, readNetworks } from "./mlp.js";
import { checkNetwork, checkNetworkFits, makeVectors, readNetwork } from "./network_block.js";
import { checkPredictors, isAttribute, readPredictors } from "./predictors.js";
import { TableBlock, TablesInForce } from "./tables.js";

/**
 * @typedef {import("./container.js").Container} Container
 * @typedef {import("./layer_block.js").Channel} Channel
 * @typedef {import("./layer_block.js").DecodedContext} DecodedContext
 * @typedef {import("./layer_block.js").Row} Row
 * @typedef {import("./codebooks.js").Codebook} Codebook
 * @typedef {import("./mlp.js").Mlp} Mlp
 * @typedef {import("./grid.js").Grid} Grid
 * @typedef {import("./network_block.js").Network} Network
 * @typedef {import("./network_block.js").Vectors} Vectors
 * @typedef {import("./predictors.js").Predictor} Predictor
 * @typedef {{
 *   layers: number,
 *   channels: Channel[],
 *   context: DecodedContext,
 *   rows: Row[],
 *   tables: TablesInForce[],
 *   decoder: Mlp | null,
 *   decoderLayer: number,
 *   codebooks: (Codebook | undefined)[],
 *   scene: Mlp[],
 *   network: Network | null,
 *   vectors: Vectors[],
 *   grid: Grid | null,
 *   predictors: Map<number, Predictor>[],
 *   dims: number,
 * }} Models
 *   rows: of layers 0..k; tables and predictors in force: of layers 1..k at 0..k - 1; vectors: of each codebook
 *   where there is a network; dims: of the latent, 0 without one; decoderLayer: where `decoder` stands, 0 without one
 */

/** @param {number} stream @param {number} component @param {number} step */
export const predictorKey = (stream, component, step) => (stream * 256 + component) * 256 + step;

/**
 * @param {Container} container
 * @param {number} layers k, 1..layer_count
 * @returns {Models}
 */
export function readModels(container, layers) {
  checkModelBlocks(container, layers);
  const { channels, context, rows, tableBlocks } = readLayers(container, layers);
  const { profile } = container.header;
  checkChannels(channels, profile);
  checkContext(context);
  checkLayerTable(rows.slice(1), channels, profile);
  const plan = planBlocks(container, rows, channels);
  checkUnexpected(container, layers, plan);
  const decoder = readDecoder(container, plan, channels);
  const codebooks = readAllCodebooks(container, plan, decoder);
  const scene = readScene(container, plan, decoder, channels);
  const neural = readNeural(container, plan, { channels, context, rows, codebooks, decoder });
  return {
    layers,
    channels,
    context,
    rows,
    tables: tableBlocks.map((_, i) => new TablesInForce(tableBlocks.slice(0, i + 1).flatMap((block) => block ?? []))),
    decoder,
    decoderLayer: plan.decoder,
    codebooks,
    scene,
    ...neural,
    predictors: readAllPredictors(container, rows, channels, context.targets.length),
    dims: decoder === null ? 0 : mlpInputs(decoder),
  };
}

/** Step 3. @param {Container} container @param {number} layers */
function checkModelBlocks(container, layers) {
  const { kind, layer } = container.entries;
  for (let e = 0; e < kind.length && layer[e] <= layers; e++) {
    if (kind[e] <= BLOCK.PREDICTORS) checkBlock(container, e);
  }
}

/**
 * Step 4.
 * @param {Container} container
 * @param {number} layers
 */
function readLayers(container, layers) {
  /** @type {ReturnType<typeof readFirstLayer> | null} */
  let first = null;
  /** @type {Row[]} */
  const rows = [];
  /** @type {(TableBlock | null)[]} */
  const tableBlocks = [];
  for (let k = 1; k <= layers; k++) {
    const e = findBlock(container, k, BLOCK.LAYER);
    demand(e >= 0, "missing-block", `layer ${k} has no LAYER block`);
    const bytes = blockBytes(container, e);
    const offset = container.entries.offset[e];
    if (first === null) {
      first = readFirstLayer(bytes, offset);
      rows.push(emptyRow(first.channels.length), first.row);
    } else {
      rows.push(readLaterLayer(bytes, offset, first.channels.length));
    }
    const t = findBlock(container, k, BLOCK.TABLES);
    tableBlocks.push(t < 0 ? null : new TableBlock(blockBytes(container, t)));
  }
  const { channels, context } = /** @type {ReturnType<typeof readFirstLayer>} */ (first);
  return { channels, context, rows, tableBlocks };
}

/**
 * The layers in which blocks stand, 0 for none.
 * @typedef {{decoder: number, books: number[], scene: number, network: number}} Plan
 */

/**
 * R-7.8-2, R-7.9-2, R-7.9-4, R-10.4-2.
 * @param {Container} container
 * @param {Row[]} rows
 * @param {Channel[]} channels
 * @returns {Plan}
 */
function planBlocks(container, rows, channels) {
  const first = (/** @type {(row: Row) => boolean} */ holds) => Math.max(rows.findIndex(holds), 0);
  return {
    decoder: first((row) => needsDecoder(row, channels)),
    books: [1, 2].map((least) => first((row) => row.stages.some((n) => n >= least))),
    scene: container.header.profile === PROFILE.ANCHOR ? 1 : 0,
    network: first((row) => row.entropy_mode === 1),
  };
}

/**
 * Step 6.
 * @param {Container} container
 * @param {number} layers
 * @param {Plan} plan
 */
function checkUnexpected(container, layers, plan) {
  const { kind, layer, offset } = container.entries;
  const allowed = new Map([
    [BLOCK.CODEBOOKS, plan.books],
    [BLOCK.DECODER_MLP, [plan.decoder]],
    [BLOCK.SCENE_MLP, [plan.scene]],
    [BLOCK.HASH_GRID, [plan.network]],
    [BLOCK.ENTROPY_NETWORK, [plan.network]],
  ]);
  for (let e = 0; e < kind.length && layer[e] <= layers; e++) {
    const stands = allowed.get(/** @type {any} */ (kind[e]))?.includes(layer[e]) ?? true;
    demand(stands, "unexpected-block", `block kind ${kind[e]} in layer ${layer[e]}`, offset[e]);
  }
}

/**
 * A block that has to be there.
 * @param {Container} container
 * @param {number} layer
 * @param {number} kind
 */
function neededBlock(container, layer, kind) {
  const e = findBlock(container, layer, kind);
  demand(e >= 0, "missing-block", `layer ${layer} has no block of kind ${kind}`);
  return { bytes: blockBytes(container, e), offset: container.entries.offset[e] };
}

/**
 * @param {Container} container
 * @param {Plan} plan
 * @param {Channel[]} channels
 * @returns {Mlp | null}
 */
function readDecoder(container, plan, channels) {
  if (plan.decoder === 0) return null;
  const networks = readNetworks(neededBlock(container, plan.decoder, BLOCK.DECODER_MLP).bytes);
  demand(networks.length === 1, "bad-mlp", `${networks.length} networks in DECODER_MLP`);
  const latent = channels.find(({ stream }) => stream === STREAM.LATENT);
  const inputs = mlpInputs(networks[0]);
  demand(latent === undefined || latent.components === inputs, "bad-mlp", `DECODER_MLP has ${inputs} inputs`);
  return networks[0];
}

/**
 * @param {Container} container
 * @param {Plan} plan
 * @param {Mlp | null} decoder
 * @returns {(Codebook | undefined)[]} (2)
 */
function readAllCodebooks(container, plan, decoder) {
  /** @type {(Codebook | undefined)[]} */
  const codebooks = [undefined, undefined];
  const layers = [...new Set(plan.books)].filter((layer) => layer > 0).sort((a, b) => a - b);
  for (const layer of layers) {
    const { bytes, offset } = neededBlock(container, layer, BLOCK.CODEBOOKS);
    const { books } = readCodebooks(bytes, offset);
    const wanted = [0, 1].filter((number) => plan.books[number] === layer);
    const found = books.map(({ number }) => number);
    demand(found.join() === wanted.join(), "bad-codebook", `codebooks ${found} in layer ${layer}`, offset);
    for (const book of books) codebooks[book.number] = book;
  }
  const inputs = decoder === null ? 0 : mlpInputs(decoder);
  for (const book of codebooks) {
    demand(book === undefined || book.dims === inputs, "bad-mlp", `codewords of ${book?.dims} dimensions`);
  }
  return codebooks;
}

/**
 * SCENE_MLP, and R-7.9-3.
 * @param {Container} container
 * @param {Plan} plan
 * @param {Mlp | null} decoder
 * @param {Channel[]} channels
 * @returns {Mlp[]}
 */
function readScene(container, plan, decoder, channels) {
  const { profile, sh_degree, slots } = container.header;
  const e = plan.scene === 0 ? -1 : findBlock(container, plan.scene, BLOCK.SCENE_MLP);
  const networks = e < 0 ? [] : readNetworks(blockBytes(container, e));
  if (profile === PROFILE.EXPLICIT) {
    const colour = channels.some(({ stream }) => stream === STREAM.COLOUR);
    const outputs = 3 * ((sh_degree + 1) ** 2 - (colour ? 1 : 0));
    const fits = decoder === null || mlpOutputs(decoder) === outputs;
    demand(fits, "bad-mlp", `DECODER_MLP has not ${outputs} outputs`);
    return [];
  }
  demand(networks.length === 3, "bad-mlp", `${networks.length} networks in SCENE_MLP`);
  if (decoder === null) throw new Refused("bad-mlp", "no DECODER_MLP");
  const inputs = mlpInputs(networks[0]) - mlpOutputs(decoder);
  networks.forEach((network, i) => {
    const outputs = slots * [1, 7, 3][i];
    const sized = network.length === 2 && mlpOutputs(network) === outputs;
    demand(sized && mlpInputs(network) === mlpInputs(networks[0]), "bad-mlp", `network ${i} of SCENE_MLP`);
  });
  demand(inputs === 3 || inputs === 4, "bad-mlp", "inputs of SCENE_MLP");
  return networks;
}

/**
 * ENTROPY_NETWORK and HASH_GRID.
 * @param {Container} container
 * @param {Plan} plan
 * @param {{channels: Channel[], context: DecodedContext, rows: Row[], codebooks: (Codebook | undefined)[],
 *   decoder: Mlp | null}} models
 * @returns {{network: Network | null, vectors: Vectors[], grid: Grid | null}}
 */
function readNeural(container, plan, { channels, context, rows, codebooks, decoder }) {
  if (plan.network === 0) return { network: null, vectors: [], grid: null };
  const { bytes, offset } = neededBlock(container, plan.network, BLOCK.ENTROPY_NETWORK);
  const network = readNetwork(bytes, offset);
  checkNetwork(network);
  const e = findBlock(container, plan.network, BLOCK.HASH_GRID);
  const grid = e < 0 ? null : readGrid(blockBytes(container, e), container.entries.offset[e]);
  checkNetworkFits(network, {
    attributes: channels.reduce((sum, { stream, components }) => sum + (isAttribute(stream) ? components : 0), 0),
    depths: context.targets.length,
    grid: grid === null ? 0 : grid.features,
    dims: decoder === null ? 0 : mlpInputs(decoder),
    stages: Math.max(...rows.map(({ stages }) => Math.max(...stages))),
  });
  const received = [0, 1].filter((number) => codebooks[number] !== undefined);
  return { network, vectors: received.map((number) => makeVectors(network, number, codebooks[number])), grid };
}

/**
 * @param {Container} container
 * @param {Row[]} rows
 * @param {Channel[]} channels
 * @param {number} depths
 * @returns {Map<number, Predictor>[]} in force in each layer, by predictorKey
 */
function readAllPredictors(container, rows, channels, depths) {
  /** @type {Map<number, Predictor>[]} */
  const inForce = [];
  for (let k = 1; k < rows.length; k++) {
    const now = new Map(inForce[k - 2] ?? []);
    const e = findBlock(container, k, BLOCK.PREDICTORS);
    if (e >= 0) {
      const predictors = readPredictors(blockBytes(container, e), container.entries.offset[e]);
      checkPredictors(predictors, channels, rows.slice(1, k + 1), depths);
      for (const predictor of predictors) {
        const { stream, component, step } = predictor.head;
        now.set(predictorKey(stream, component, step), predictor);
      }
    }
    inForce.push(now);
  }
  return inForce;
}

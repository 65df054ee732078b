/** Answers of the WebAssembly decoder to the questions of the decoder protocol (conformance/PROTOCOL.md). */

import { createHash } from "node:crypto";
import { closeSync, fstatSync, openSync, readSync } from "node:fs";
import { addBlock, advanceTile, newTile, openModule, takeGaussians } from "../src/decoder/wasm.js";
import { type Address, WasmModule } from "../src/decoder/wasm_module.js";
import { crc32 } from "../src/format/crc32.js";
import { type Directory, frontLength, parseFront } from "../src/format/directory.js";
import { demand, Refused } from "../src/format/errors.js";
import { MOST_HEADER } from "../src/format/header.js";
import { BLOCK, PROFILE } from "../src/format/registry.js";
import { parseStreaming } from "../src/format/streaming.js";
import { blocksOf, type FileBlock } from "./files.js";

/** Stages of the answer to `all`. */
const STAGES = ["container", "models", "indices", "integers", "sums", "values", "activated"];

export const CAPABILITIES = {
  protocol: "scar-conformance 2",
  decoder: "scar-stream wasm",
  versions: ["0.3"],
  profiles: ["explicit", "anchor"],
  stages: [...STAGES, "streaming"],
};

export interface Question {
  file: string;
  /** 0 for all. */
  layers: number;
  stage: string;
  /** Origin of the header unless given. */
  camera?: [number, number, number];
}

type Numbers = Uint8Array | Uint16Array | Uint32Array | Int32Array | Float32Array | Float64Array;

/** Names of stream kinds, SPEC §16.6. */
const STREAMS = "MODELS POSITIONS CLASSES MASKS POSITION_RESIDUAL SCALE ROTATION OPACITY COLOUR INDICES LATENT OFFSETS FRAMING".split(" ");
const [POSITION_RESIDUAL, OPACITY, OFFSETS] = ["POSITION_RESIDUAL", "OPACITY", "OFFSETS"].map((name) => STREAMS.indexOf(name));
const DTYPES = new Map<Function, string>([
  [Uint8Array, "|u1"], [Uint16Array, "<u2"], [Uint32Array, "<u4"], [Int32Array, "<i4"], [Float32Array, "<f4"], [Float64Array, "<f8"],
]);
/** What scar_model_number and scar_values give by number. */
const NUMBER = { channels: 0, stream: 1, components: 2, dims: 3, stages: 4, bookSize: 5, gridLevels: 6, gridBits: 7, gridFeatures: 8, decoderOutputs: 9 };
const ARRAY = { codes: 0, classes: 1, integers: 2, indices: 3, slots: 4 };
const EXACT = { positions: 5, values: 6, sums: 7, latents: 8 };

/** The answer to a question, an object for JSON. What is thrown is a failure, not an answer. */
export function answer(compiled: WebAssembly.Module, question: Question): object {
  const file = new OpenFile(question.file);
  try {
    if (question.stage === "streaming") return { stages: { streaming: { streaming: streamingOf(readDirectory(file), file) } } };
    const stages = question.stage === "all" ? STAGES : [question.stage];
    if (!stages.every((stage) => STAGES.includes(stage))) throw new RangeError(`no stage ${question.stage}`);
    const front = readDirectory(file);
    const blocks = blocksOf(front);
    const found: Record<string, object> = {};
    if (stages.includes("container")) found.container = containerOf(front, blocks);
    if (stages.some((stage) => stage !== "container")) {
      const arrays = new Decoding(compiled, file, front, blocks, question).arrays;
      for (const stage of stages) found[stage] ??= { arrays: arrays.json(stage) };
    }
    return { stages: Object.fromEntries(stages.map((stage) => [stage, found[stage]])) };
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    return { refused: error.id, offset: error.offset, message: error.message };
  } finally {
    file.close();
  }
}

class OpenFile {
  readonly #file: number;
  readonly length: number;

  constructor(path: string) {
    this.#file = openSync(path, "r");
    this.length = fstatSync(this.#file).size;
  }

  read(offset: number, length: number): Uint8Array {
    const bytes = new Uint8Array(Math.min(length, this.length - offset));
    for (let at = 0; at < bytes.length; ) at += readSync(this.#file, bytes, at, bytes.length - at, offset + at);
    return bytes;
  }

  close(): void {
    closeSync(this.#file);
  }
}

/** Every page is opened, in the order of the file. */
function readDirectory(file: OpenFile): Directory {
  const length = frontLength(file.read(0, MOST_HEADER), file.length);
  const front = parseFront(file.read(0, length), file.length);
  const { offset, length: sizes } = front.entries;
  for (let page = 0; page < front.pageEntries; page++) {
    if (!front.isOpen(page)) front.openPage(page, file.read(offset[page], sizes[page]));
  }
  return front;
}

/** R-5.6-1. */
function checkedBody(file: OpenFile, { offset, length, crc32: wanted }: FileBlock): Uint8Array {
  const bytes = file.read(offset, length);
  demand(crc32(bytes) === wanted, "crc-mismatch", "the CRC of a block", offset);
  return bytes;
}

/** The fields of STREAMING, null without the block. */
function streamingOf(front: Directory, file: OpenFile): object | null {
  const block = blocksOf(front).find(({ kind, layer }) => kind === BLOCK.STREAMING && layer === 1);
  if (block === undefined) return null;
  const { tiles, view, low, high, reach } = parseStreaming(checkedBody(file, block), block.offset);
  demand(tiles === front.index.tiles, "bad-streaming", `${tiles} tiles of ${front.index.tiles}`, block.offset);
  const triples = (bytes: Uint8Array) => Array.from(reach, (_, tile) => [...bytes.subarray(3 * tile, 3 * tile + 3)]);
  return { view: view?.map((number) => bitsOf(number, 8)) ?? null, low: triples(low), high: triples(high), reach: [...reach] };
}

/** Arrays by stage and name, which arrive tile by tile. */
class StageArrays {
  readonly #found = new Map<string, { stage: string; name: string; dtype: string; row: number[]; rows: number; parts: Uint8Array[] }>();

  /** @param row shape without the first dimension @param rows how many, where a row may be empty */
  add(stage: string, name: string, row: number[], numbers: Numbers, rows?: number, dtype = DTYPES.get(numbers.constructor)!): void {
    const key = `${stage} ${name}`;
    const array = this.#found.get(key) ?? { stage, name, dtype, row, rows: 0, parts: [] };
    this.#found.set(key, array);
    const size = Number(dtype.slice(2));
    array.rows += rows ?? numbers.byteLength / size / row.reduce((product, n) => product * n, 1);
    array.parts.push(new Uint8Array(numbers.buffer, numbers.byteOffset, numbers.byteLength));
  }

  /** Numbers of `activated` are given themselves, of others their SHA-256. */
  json(stage: string): Record<string, object> {
    const own = [...this.#found.values()].filter((array) => array.stage === stage);
    return Object.fromEntries(
      own.map(({ name, dtype, row, rows, parts }) => {
        const bytes = Buffer.concat(parts);
        const content = stage === "activated" ? { data: bytes.toString("base64") } : { sha256: createHash("sha256").update(bytes).digest("hex") };
        return [name, { dtype, shape: [rows, ...row], ...content }];
      }),
    );
  }
}

interface Channel {
  stream: number;
  components: number;
}

class Decoding {
  readonly arrays = new StageArrays();
  readonly #module: WasmModule;
  readonly #layers: number;
  #channels: Channel[] = [];

  constructor(
    compiled: WebAssembly.Module,
    readonly file: OpenFile,
    readonly front: Directory,
    readonly blocks: FileBlock[],
    { layers, camera }: Question,
  ) {
    this.#module = new WasmModule(compiled);
    this.#layers = layers === 0 ? front.index.layers : layers;
    if (!(this.#layers >= 1 && this.#layers <= front.index.layers)) throw new RangeError(`no layer ${layers}`);
    this.#addModels();
    // Every array is declared by a tile of no anchors, for files without tiles.
    this.#addTile(0, 0, camera);
    for (let tile = 0; tile < front.index.tiles; tile++) this.#decodeTile(tile, camera);
  }

  /** All model blocks first, in one call: so rules are applied in the order of R-12.2-1. */
  #addModels(): void {
    const chosen = this.blocks.filter(({ layer, kind }) => layer <= this.#layers && kind <= BLOCK.PREDICTORS);
    const bodies = chosen.map((block) => checkedBody(this.file, block));
    openModule(this.#module, this.front.header);
    chosen.forEach(({ layer, kind }, i) => addBlock(this.#module, layer, kind, bodies[i]));
    this.#module.call((f) => f.scar_models(this.#module.scar, 1, this.#layers));
    const channels = Array.from({ length: this.#number(NUMBER.channels) }, (_, c) => c);
    this.#channels = channels.map((c) => ({ stream: this.#number(NUMBER.stream, c), components: this.#number(NUMBER.components, c) }));
    const dims = this.#number(NUMBER.dims);
    for (const book of [0, 1]) {
      const size = this.#number(NUMBER.bookSize, book);
      const words = this.#module.call((f) => f.scar_model_words(this.#module.scar, book));
      if (size > 0) this.arrays.add("models", `codebook.${book}`, [dims], this.#module.numbers(Int32Array, words, size * dims));
    }
    for (let level = 0; level < this.#number(NUMBER.gridLevels); level++) {
      const at = this.#module.call((f) => f.scar_model_bits(this.#module.scar, level));
      const bits = this.#module.numbers(Uint8Array, at, this.#number(NUMBER.gridBits, level));
      this.arrays.add("models", `grid.bits.${level}`, [this.#number(NUMBER.gridFeatures, level)], bits);
    }
  }

  #number(what: number, which = 0): number {
    return this.#module.call((f) => f.scar_model_number(this.#module.scar, what, which));
  }

  #decodeTile(tile: number, camera: Question["camera"]): void {
    let state = newTile(this.#module, this.front.cube(tile));
    for (let layer = 1; layer <= this.#layers; layer++) {
      const block = this.blocks.find((one) => one.layer === layer && one.tile === tile);
      state = advanceTile(this.#module, state, block === undefined ? new Uint8Array(0) : checkedBody(this.file, block), block?.count ?? 0);
    }
    this.#addTile(tile, state, camera);
    this.#module.call((f) => f.scar_release(state));
  }

  /** @param state 0: a tile without anchors */
  #addTile(tile: number, state: Address, camera: Question["camera"]): void {
    const { slots, profile } = this.front.header;
    const { arrays } = this;
    const module = this.#module;
    const n = state === 0 ? 0 : module.call((f) => f.scar_tile_count(state));
    const at = (what: number, channel = 0) => (state === 0 ? 0 : module.call((f) => f.scar_values(module.scar, state, what, channel)));
    const stages = this.#number(NUMBER.stages);
    arrays.add("indices", "index", [stages], module.numbers(Uint16Array, at(ARRAY.indices), n * stages), n);
    arrays.add("integers", "tile", [], new Uint32Array(n).fill(tile));
    arrays.add("integers", "code", [], module.numbers(Uint32Array, at(ARRAY.codes), 2 * n), undefined, "<u8");
    arrays.add("integers", "class", [], module.numbers(Uint8Array, at(ARRAY.classes), n));
    if (profile === PROFILE.ANCHOR) {
      arrays.add("integers", "slot_layer", [slots], module.numbers(Uint8Array, at(ARRAY.slots), n * slots));
    }
    this.#channels.forEach((channel, c) => {
      arrays.add("integers", `v.${STREAMS[channel.stream]}`, this.#row(channel), this.#integers(channel, at(ARRAY.integers, c), n));
    });
    this.#addValues(state, n, camera);
  }

  /** Shape of a channel without the first dimension. */
  #row({ stream, components }: Channel): number[] {
    return stream === OFFSETS ? [this.front.header.slots, components] : [components];
  }

  /** (n, components) of planes; OFFSETS has rows already. */
  #integers({ stream, components }: Channel, at: Address, n: number): Int32Array {
    if (stream === OFFSETS) return this.#module.numbers(Int32Array, at, n * components * this.front.header.slots);
    const planes = this.#module.numbers(Int32Array, at, n * components);
    return planes.map((_, i) => planes[(i % components) * n + Math.floor(i / components)]);
  }

  #addValues(state: Address, n: number, camera: Question["camera"]): void {
    const module = this.#module;
    const { profile, origin, slots, sh_degree } = this.front.header;
    const at = (what: number, channel = 0) => (state === 0 ? 0 : module.call((f) => f.scar_values(module.scar, state, what, channel)));
    const dims = this.#number(NUMBER.dims);
    const outputs = this.#number(NUMBER.decoderOutputs);
    this.arrays.add("values", "position", [3], module.numbers(Float64Array, at(EXACT.positions), 3 * n));
    let opacities = new Float32Array(n);
    this.#channels.forEach((channel, c) => {
      if (channel.stream === POSITION_RESIDUAL) return;
      const row = this.#row(channel);
      const values = module.numbers(Float32Array, at(EXACT.values, c), row.reduce((product, width) => product * width, n));
      if (channel.stream === OPACITY) opacities = values as Float32Array<ArrayBuffer>;
      this.arrays.add("values", `value.${STREAMS[channel.stream]}`, row, values);
    });
    if (outputs > 0) {
      this.arrays.add("sums", "codeword_sum", [dims], module.numbers(Int32Array, at(EXACT.sums), n * dims));
      this.arrays.add("values", "latent", [dims], module.numbers(Float32Array, at(EXACT.latents), n * dims));
    }
    const [x, y, z] = camera ?? origin;
    const gaussians = state === 0 ? 0 : module.call((f) => f.scar_gaussians(module.scar, state, x, y, z, 0));
    const { centres, scales, quats, opacity, sh } = takeGaussians(module, gaussians);
    const activated = (name: string, row: number[], numbers: ArrayLike<number>) =>
      this.arrays.add("activated", name, row, state === 0 ? new Float64Array(0) : Float64Array.from(numbers), n);
    if (profile === PROFILE.EXPLICIT) {
      activated("rotation", [4], quats);
      activated("logit", [], Array.from(opacities, logit));
      activated("opacity", [], opacity);
      activated("sh", [(sh_degree + 1) ** 2, 3], sh);
      return;
    }
    const [features] = module.numbers(Uint32Array, gaussians + 28, 1);
    activated("feature", [outputs], state === 0 ? [] : module.numbers(Float32Array, features, outputs * n));
    activated("gaussian.opacity", [slots], opacity);
    activated("gaussian.scale", [slots, 3], scales);
    activated("gaussian.rotation", [slots, 4], quats);
    activated("gaussian.colour", [slots, 3], sh);
    activated("gaussian.centre", [slots, 3], centres);
  }
}

/** R-9.4-1; the module itself has no use for it. */
function logit(logOpacity: number): number {
  const y = Math.min(logOpacity, -(2 ** -13));
  return y - Math.log(-Math.expm1(y));
}

/** Bits of a number, most significant first, in hexadecimal digits. */
function bitsOf(number: number, digits = 16): string {
  const view = new DataView(new ArrayBuffer(8));
  if (digits === 8) view.setFloat32(4, number);
  else view.setFloat64(0, number);
  return view.getBigUint64(0).toString(16).padStart(digits, "0");
}

/** The fields of the tables of §5, integers as strings. */
function containerOf(front: Directory, blocks: FileBlock[]): object {
  const { header, layers } = front;
  const special = { signature: Buffer.from(header.signature).toString("hex"), origin: header.origin.map((x) => bitsOf(x)), voxel: bitsOf(header.voxel) };
  const cubes = Array.from({ length: front.index.tiles }, (_, tile) => front.cube(tile));
  const entries = blocks.map(({ tile, ...block }) => ({ ...block, tile: tile ?? 0xffffffff }));
  return {
    container: {
      header: { ...strings(header), ...special },
      layers: layers.map(strings),
      tiles: cubes.map(strings),
      entries: entries.map(strings),
    },
  };
}

function strings(record: object): Record<string, unknown> {
  const text = (value: unknown) => (Array.isArray(value) ? value.map(String) : String(value));
  return Object.fromEntries(Object.entries(record).map(([name, value]) => [name, text(value)]));
}

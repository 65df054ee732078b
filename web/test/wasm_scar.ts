/** The WebAssembly decoder as the JavaScript decoder's `Scar`: what answers to the decoder protocol are made from. */

import { BLOCK, PROFILE, STREAM } from "../../conformance/decoders/js/constants.js";
import { blockBytes, checkBlock, findBlock } from "../../conformance/decoders/js/container.js";
import { openScar, Scar } from "../../conformance/decoders/js/decoder.js";
import { advanceTile, newTile, openModule, takeGaussians } from "../src/decoder/wasm.js";
import { type Address, WasmModule } from "../src/decoder/wasm_module.js";

/** Stages of the protocol that the module can tell of. */
export const STAGES = ["container", "models", "indices", "integers", "sums", "values", "activated"];

const NUMBER = {
  channels: 0,
  stream: 1,
  components: 2,
  dims: 3,
  stages: 4,
  bookSize: 5,
  gridLevels: 6,
  gridBits: 7,
  gridFeatures: 8,
  decoderOutputs: 9,
};
const ARRAY = { codes: 0, classes: 1, integers: 2, indices: 3, slots: 4 };
const EXACT = { positions: 0, values: 1, sums: 2, latents: 3 };

type Channel = { stream: number; components: number };

/** @param compiled of dist/scar.wasm @returns what openScar is for the JavaScript decoder */
export function wasmOpener(compiled: WebAssembly.Module) {
  return (source: Parameters<typeof openScar>[0]) => new WasmScar(openScar(source), compiled);
}

class WasmScar extends Scar {
  readonly #module: WasmModule;

  constructor(scar: Scar, compiled: WebAssembly.Module) {
    super(scar.container, scar.limits);
    this.#module = new WasmModule(compiled);
  }

  /** All model blocks first, in one call: so rules are applied in the order of R-12.2-1. */
  override models(layers = 0): any {
    const { container } = this;
    const { kind, layer } = container.entries;
    const k = layers === 0 ? this.header.layer_count : layers;
    const chosen = [...kind.keys()].filter((e) => layer[e] <= k && kind[e] <= BLOCK.PREDICTORS);
    for (const e of chosen) checkBlock(container, e);
    openModule(this.#module, container.header);
    for (const e of chosen) {
      const bytes = blockBytes(container, e);
      const at = this.#module.put(bytes);
      this.#module.call((f) => f.scar_block(layer[e], kind[e], at, bytes.length));
    }
    this.#module.call((f) => f.scar_models(1, k));
    return this.#described(k);
  }

  #number(what: number, which = 0): number {
    return this.#module.call((f) => f.scar_model_number(what, which));
  }

  #described(layers: number) {
    const dims = this.#number(NUMBER.dims);
    const books = [0, 1].map((number) => ({ number, dims, size: this.#number(NUMBER.bookSize, number) }));
    const outputs = this.#number(NUMBER.decoderOutputs);
    const levels = [...Array(this.#number(NUMBER.gridLevels)).keys()];
    const bits = (level: number) => this.#module.call((f) => f.scar_model_bits(level));
    return {
      layers,
      dims,
      channels: [...Array(this.#number(NUMBER.channels)).keys()].map((c) => ({
        stream: this.#number(NUMBER.stream, c),
        components: this.#number(NUMBER.components, c),
      })),
      stages: this.#number(NUMBER.stages),
      decoder: outputs === 0 ? null : [{ rows: outputs }],
      codebooks: books.map((book) => (book.size === 0 ? undefined : { ...book, words: this.#words(book) })),
      grid:
        levels.length === 0
          ? null
          : {
              levels: levels.map((level) => ({
                features: this.#number(NUMBER.gridFeatures, level),
                bits: this.#module.numbers(Uint8Array, bits(level), this.#number(NUMBER.gridBits, level)),
              })),
            },
    };
  }

  #words({ number, size, dims }: { number: number; size: number; dims: number }): Int32Array {
    const at = this.#module.call((f) => f.scar_model_words(number));
    return this.#module.numbers(Int32Array, at, size * dims);
  }

  override emptyTile(models: any): any {
    return this.#tile(models, -1, 0);
  }

  override *tiles({ models }: any): Generator<any> {
    const { container } = this;
    for (let number = 0; number < this.header.tile_count; number++) {
      const { depth, shift, prefix } = container.tiles;
      let state = newTile(this.#module, { depth: depth[number], shift: shift[number], prefix: prefix[number] });
      for (let layer = 1; layer <= models.layers; layer++) {
        const e = findBlock(container, layer, BLOCK.TILE, number);
        if (e >= 0) checkBlock(container, e);
        const body = e < 0 ? new Uint8Array(0) : blockBytes(container, e);
        state = advanceTile(this.#module, state, body, e < 0 ? 0 : container.entries.count[e]);
      }
      yield this.#tile(models, number, state);
      this.#module.call((f) => f.scar_release(state));
    }
  }

  /** A tile as answers.js looks at it; state 0: one without anchors. */
  #tile(models: any, number: number, state: Address) {
    const size = state === 0 ? 0 : this.#module.call((f) => f.scar_tile_count(state));
    const slots = this.header.slots;
    const anchorProfile = this.header.profile === PROFILE.ANCHOR;
    const at = (what: number, channel = 0) =>
      state === 0 ? 0 : this.#module.call((f) => f.scar_tile_array(state, what, channel));
    const codes = this.#module.numbers(Uint32Array, at(ARRAY.codes), 2 * size);
    const low32 = this.#module.numbers(Uint32Array, at(ARRAY.classes), 2 * size);
    return {
      models,
      number,
      state,
      size,
      slots,
      anchorProfile,
      stages: models.stages,
      codes: { low: codes.filter((_, i) => i % 2 === 0), high: codes.filter((_, i) => i % 2 === 1) },
      ofClass: Uint8Array.from(low32.filter((_, i) => i % 2 === 0)),
      slotLayer: this.#module.numbers(Uint8Array, at(ARRAY.slots), anchorProfile ? size * slots : 0),
      index: this.#module.numbers(Uint16Array, at(ARRAY.indices), size * models.stages),
      v: models.channels.map((channel: Channel, c: number) => this.#integers(channel, at(ARRAY.integers, c), size)),
    };
  }

  /** (n, components) of planes; OFFSETS has rows already. */
  #integers({ stream, components }: Channel, at: Address, size: number): Int32Array {
    if (stream === STREAM.OFFSETS) return this.#module.numbers(Int32Array, at, size * components * this.header.slots);
    const planes = this.#module.numbers(Int32Array, at, size * components);
    return planes.map((_, i) => planes[(i % components) * size + Math.floor(i / components)]);
  }

  override exactValues({ models, state, size }: any): any {
    const { dims, channels, decoder } = models;
    const at = (what: number, channel = 0) =>
      state === 0 ? 0 : this.#module.call((f) => f.scar_exact(state, what, channel));
    const values = new Map<number, Float32Array>();
    channels.forEach(({ stream, components }: Channel, c: number) => {
      const width = components * (stream === STREAM.OFFSETS ? this.header.slots : 1);
      if (stream === STREAM.POSITION_RESIDUAL) return;
      values.set(stream, this.#module.numbers(Float32Array, at(EXACT.values, c), size * width));
    });
    const n = decoder === null ? 0 : size * dims;
    return {
      position: this.#module.numbers(Float64Array, at(EXACT.positions), 3 * size),
      values,
      sums: decoder === null ? null : this.#module.numbers(Int32Array, at(EXACT.sums), n),
      latent: decoder === null ? null : this.#module.numbers(Float32Array, at(EXACT.latents), n),
    };
  }

  override activatedValues({ models, state, size }: any, exact: any, eye = this.header.origin): any {
    const [x, y, z] = eye;
    const anchors = this.header.profile === PROFILE.ANCHOR;
    const at = state === 0 ? 0 : this.#module.call((f) => f.scar_gaussians(state, x, y, z, 0));
    const all = (array: Float32Array) => (state === 0 ? new Float64Array(0) : Float64Array.from(array));
    const { centres, scales, quats, opacity, sh } = takeGaussians(this.#module, at);
    if (!anchors) {
      const opacities: Float32Array = exact.values.get(STREAM.OPACITY) ?? new Float32Array(size);
      return { rotation: all(quats), logit: Float64Array.from(opacities, logit), opacity: all(opacity), sh: all(sh) };
    }
    const [features] = this.#module.numbers(Uint32Array, at + 28, 1);
    const width = models.decoder[0].rows * size;
    return {
      feature: all(this.#module.numbers(Float32Array, state === 0 ? 0 : features, width)),
      "gaussian.opacity": all(opacity),
      "gaussian.scale": all(scales),
      "gaussian.rotation": all(quats),
      "gaussian.colour": all(sh),
      "gaussian.centre": all(centres),
    };
  }
}

/** R-9.4-1; the module itself has no use for it. */
function logit(logOpacity: number): number {
  const y = Math.min(logOpacity, -(2 ** -13));
  return y - Math.log(-Math.expm1(y));
}

/** The decoder in WebAssembly: the C kernel of scarfmt, with SIMD. */

import { BLOCK, DEFAULT_LIMITS } from "../../../conformance/decoders/js/constants.js";
import { type Container, findBlock, readContainer } from "../../../conformance/decoders/js/container.js";
import { SparseSource } from "./sparse.js";
import type { Block, PackedTile, PackTarget, Point, TileDecoder, TileValues } from "./types.js";
import { type Address, WasmModule } from "./wasm_module.js";

const FILE_LENGTH_AT = 16;
const HEADER_LEAST = 24;
const NO_BYTES = new Uint8Array(0);

/**
 * A decoder that runs on the calling thread.
 * @param module compiled from dist/scar.wasm; workers share it
 */
export function createWasmDecoder(module: WebAssembly.Module): TileDecoder {
  return new WasmDecoder(new WasmModule(module));
}

/** What a front says, checked by §5. */
export function readFront(front: Uint8Array): Container {
  const view = new DataView(front.buffer, front.byteOffset, front.byteLength);
  const whole = front.length < HEADER_LEAST ? front.length : Number(view.getBigUint64(FILE_LENGTH_AT, true));
  const source = new SparseSource(whole);
  source.put(0, front);
  return readContainer(source, DEFAULT_LIMITS, false);
}

/** Tells the module what it needs of a header. */
export function openModule(module: WasmModule, { header }: Container): void {
  const { profile, sh_degree, slots, lattice_bits, file_length, origin, voxel } = header;
  const [x, y, z] = origin;
  module.call((f) => f.scar_open(profile, sh_degree, slots, lattice_bits, file_length, x, y, z, voxel));
}

/** A tile of which nothing is decoded yet. */
export function newTile(module: WasmModule, { tiles }: Container, number: number): Address {
  const prefix = tiles.prefix[number];
  const [low, high] = [Number(prefix & 0xffffffffn), Number(prefix >> 32n)];
  return module.call((f) => f.scar_tile(tiles.depth[number], tiles.shift[number], low, high));
}

/** Takes a tile to its next layer; it is gone where the call is refused. @returns where it lies now */
export function advanceTile(module: WasmModule, tile: Address, body: Uint8Array, appear: number): Address {
  const at = body.length > 0 ? module.put(body) : 0;
  try {
    return module.call((f) => f.scar_advance(tile, at, body.length, appear));
  } catch (error) {
    module.call((f) => f.scar_abandon());
    throw error;
  } finally {
    if (at !== 0) module.call((f) => f.scar_give(at));
  }
}

class WasmDecoder implements TileDecoder {
  readonly engine = "wasm";
  #container: Container | null = null;
  #layers = 0;
  readonly #tiles = new Map<number, Address>();

  constructor(readonly module: WasmModule) {}

  open(front: Uint8Array): void {
    if (this.#container !== null) throw new RangeError("a decoder serves one file");
    const container = readFront(front);
    openModule(this.module, container);
    this.#container = container;
  }

  addModels(layer: number, blocks: Block[]): void {
    this.#opened();
    if (layer !== this.#layers + 1) throw new RangeError(`models of layer ${layer} are not the next`);
    for (const { kind, body } of blocks) {
      if (kind > BLOCK.PREDICTORS) continue;
      const at = this.module.put(body);
      this.module.call((f) => f.scar_block(layer, kind, at, body.length));
    }
    this.module.call((f) => f.scar_models(layer, layer));
    this.#layers = layer;
  }

  advance(tile: number, layer: number, body: Uint8Array): void {
    const container = this.#opened();
    if (layer > this.#layers) throw new RangeError(`no models of layer ${layer}`);
    if (!(tile >= 0 && tile < container.header.tile_count)) throw new RangeError(`no tile ${tile}`);
    const state = this.#tiles.get(tile) ?? newTile(this.module, container, tile);
    const before = this.module.call((f) => f.scar_tile_layer(state));
    if (layer !== before + 1) throw new RangeError(`tile ${tile} is at layer ${before}, not ${layer - 1}`);
    const e = findBlock(container, layer, BLOCK.TILE, tile);
    this.#tiles.delete(tile);
    const advanced =
      e < 0
        ? advanceTile(this.module, state, NO_BYTES, 0)
        : advanceTile(this.module, state, body, container.entries.count[e]);
    this.#tiles.set(tile, advanced);
  }

  values(tile: number, eye?: Point): TileValues {
    const { header } = this.#opened();
    const state = this.#state(tile);
    const [x, y, z] = eye ?? header.origin;
    const layer = this.module.call((f) => f.scar_tile_layer(state));
    const at = this.module.call((f) => f.scar_gaussians(state, x, y, z, 1));
    return { tile, layer, ...takeGaussians(this.module, at) };
  }

  packed(tile: number, target: PackTarget, eye?: Point): PackedTile {
    if (target !== "words") throw new RangeError(`no target ${target}`);
    const [x, y, z] = eye ?? this.#opened().header.origin;
    const state = this.#state(tile);
    const layer = this.module.call((f) => f.scar_tile_layer(state));
    const at = this.module.call((f) => f.scar_words(state, x, y, z));
    return { tile, layer, ...takeWords(this.module, at) };
  }

  release(tile: number): void {
    const state = this.#tiles.get(tile);
    if (state === undefined) return;
    this.#tiles.delete(tile);
    this.module.call((f) => f.scar_release(state));
  }

  memory(): number {
    return this.module.call((f) => f.scar_memory());
  }

  #state(tile: number): Address {
    const state = this.#tiles.get(tile);
    if (state === undefined) throw new RangeError(`tile ${tile} is not decoded`);
    return state;
  }

  #opened(): Container {
    if (this.#container === null) throw new RangeError("open comes first");
    return this.#container;
  }
}

/** The struct Words of web/wasm/words.c: two numbers, then addresses. */
function takeWords(module: WasmModule, at: Address): Omit<PackedTile, "tile" | "layer"> {
  const [count, shDegree, geometry, harmonics] = module.numbers(Uint32Array, at, 4);
  const words = (address: number, width: number) => module.numbers(Uint32Array, address, width * count);
  return { count, shDegree, geometry: words(geometry, 8), harmonics: words(harmonics, 4 * shDegree) };
}

/** The struct Gaussians of web/wasm/gaussians.h: two numbers, then addresses. */
export function takeGaussians(module: WasmModule, at: Address): Omit<TileValues, "tile" | "layer"> {
  const [count, coefficients, centres, scales, quats, opacity, sh] = module.numbers(Uint32Array, at, 7);
  const floats = (address: number, width: number) => module.numbers(Float32Array, address, width * count);
  return {
    count,
    centres: floats(centres, 3),
    scales: floats(scales, 3),
    quats: floats(quats, 4),
    opacity: floats(opacity, 1),
    sh: floats(sh, 3 * coefficients),
    shDegree: Math.round(Math.sqrt(coefficients)) - 1,
  };
}

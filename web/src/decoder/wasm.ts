/** The decoder in WebAssembly: the C kernel of scarfmt, with SIMD. */

import { BLOCK, DEFAULT_LIMITS } from "../../../conformance/decoders/js/constants.js";
import { readFront } from "../../../conformance/decoders/js/container.js";
import { startOf } from "./sparse.js";
import type { Block, Cube, PackedTile, PackTarget, Point, TileBlock, TileDecoder, TileValues } from "./types.js";
import { type Address, WasmModule } from "./wasm_module.js";

type Header = ReturnType<typeof readFront>["header"];

/**
 * A decoder that runs on the calling thread.
 * @param module compiled from dist/scar.wasm; workers share it
 */
export function createWasmDecoder(module: WebAssembly.Module): TileDecoder {
  return new WasmDecoder(new WasmModule(module));
}

/** Tells the module what it needs of a header. */
export function openModule(module: WasmModule, header: Header): void {
  const { profile, sh_degree, slots, lattice_bits, file_length, origin, voxel } = header;
  const [x, y, z] = origin;
  module.call((f) => f.scar_open(profile, sh_degree, slots, lattice_bits, file_length, x, y, z, voxel));
}

/** A tile of which nothing is decoded yet. */
export function newTile(module: WasmModule, { depth, shift, prefix }: Cube): Address {
  const [low, high] = [Number(prefix & 0xffffffffn), Number(prefix >> 32n)];
  return module.call((f) => f.scar_tile(depth, shift, low, high));
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
  #header: Header | null = null;
  #layers = 0;
  readonly #tiles = new Map<number, Address>();

  constructor(readonly module: WasmModule) {}

  open(front: Uint8Array): void {
    if (this.#header !== null) throw new RangeError("a decoder serves one file");
    const { header } = readFront(startOf(front), DEFAULT_LIMITS, false);
    openModule(this.module, header);
    this.#header = header;
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

  advance(tile: number, cube: Cube, { layer, count, body }: TileBlock): void {
    const { tile_count } = this.#opened();
    if (layer > this.#layers) throw new RangeError(`no models of layer ${layer}`);
    if (!(tile >= 0 && tile < tile_count)) throw new RangeError(`no tile ${tile}`);
    const state = this.#tiles.get(tile) ?? newTile(this.module, cube);
    const before = this.module.call((f) => f.scar_tile_layer(state));
    if (layer !== before + 1) throw new RangeError(`tile ${tile} is at layer ${before}, not ${layer - 1}`);
    this.#tiles.delete(tile);
    this.#tiles.set(tile, advanceTile(this.module, state, body, body.length > 0 ? count : 0));
  }

  values(tile: number, eye?: Point): TileValues {
    const { origin } = this.#opened();
    const state = this.#state(tile);
    const [x, y, z] = eye ?? origin;
    const layer = this.module.call((f) => f.scar_tile_layer(state));
    const at = this.module.call((f) => f.scar_gaussians(state, x, y, z, 1));
    return { tile, layer, ...takeGaussians(this.module, at) };
  }

  packed(tile: number, target: PackTarget, eye?: Point): PackedTile {
    if (target !== "words") throw new RangeError(`no target ${target}`);
    const [x, y, z] = eye ?? this.#opened().origin;
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

  #opened(): Header {
    if (this.#header === null) throw new RangeError("open comes first");
    return this.#header;
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

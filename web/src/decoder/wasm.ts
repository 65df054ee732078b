/** The decoder in WebAssembly: the C kernel of scarfmt, with SIMD. */

import { parseFront } from "../format/directory.js";
import type { Header } from "../format/header.js";
import { BLOCK } from "../format/registry.js";
import type { Block, Cube, PackedTile, Point, TileBlock, TileValues } from "./types.js";
import { type Address, WasmModule } from "./wasm_module.js";

/** Bits of all sub-streams. */
const ALL_STREAMS = 0xffff;

/** Opens a file by what the module needs of its header. */
export function openModule(module: WasmModule, header: Header): void {
  const { profile, sh_degree, slots, lattice_bits, file_length, origin, voxel } = header;
  const [x, y, z] = origin;
  if (module.scar !== 0) module.call((f) => f.scar_close(module.scar));
  module.scar = module.call((f) => f.scar_open(profile, sh_degree, slots, lattice_bits, file_length, x, y, z, voxel));
}

/** Takes a model block. */
export function addBlock(module: WasmModule, layer: number, kind: number, body: Uint8Array): void {
  const at = module.put(body);
  module.call((f) => f.scar_block(module.scar, layer, kind, at, body.length));
  module.call((f) => f.scar_give(at));
}

/** A tile of which nothing is decoded yet. */
export function newTile(module: WasmModule, { depth, shift, prefix }: Cube): Address {
  const [low, high] = [Number(prefix & 0xffffffffn), Number(prefix >> 32n)];
  return module.call((f) => f.scar_tile(module.scar, depth, shift, low, high));
}

/** Takes a tile to its next layer; it is gone where the call is refused. @returns where it lies now */
export function advanceTile(module: WasmModule, tile: Address, body: Uint8Array, appear: number): Address {
  const at = body.length > 0 ? module.put(body) : 0;
  try {
    return module.call((f) => f.scar_advance(module.scar, tile, at, body.length, appear, ALL_STREAMS));
  } finally {
    if (at !== 0) module.call((f) => f.scar_give(at));
  }
}

/**
 * Decodes the tiles of one file, on the calling thread. Throws Refused for what is wrong with a file: a tile that threw is
 * forgotten, as after `release`; others are not touched. Calls out of order throw RangeError.
 */
export class WasmDecoder {
  readonly module: WasmModule;
  #header: Header | null = null;
  #layers = 0;
  readonly #tiles = new Map<number, Address>();

  /** @param module compiled from dist/scar.wasm; workers share it */
  constructor(module: WebAssembly.Module) {
    this.module = new WasmModule(module);
  }

  /** Reads header and ROOT, checked by §5. @param front the first bytes of the file, up to the end of ROOT or beyond */
  open(front: Uint8Array): void {
    if (this.#header !== null) throw new RangeError("a decoder serves one file");
    const { header } = parseFront(front, null);
    openModule(this.module, header);
    this.#header = header;
  }

  /**
   * Takes every block of a layer that belongs to no tile, in the order of the file; once a layer, layer by layer. Kinds
   * that it does not know are ignored.
   */
  addModels(layer: number, blocks: Block[]): void {
    this.#opened();
    if (layer !== this.#layers + 1) throw new RangeError(`models of layer ${layer} are not the next`);
    for (const { kind, body } of blocks) {
      if (kind > BLOCK.PREDICTORS) continue;
      addBlock(this.module, layer, kind, body);
    }
    this.module.call((f) => f.scar_models(this.module.scar, layer, layer));
    this.#layers = layer;
  }

  /**
   * Takes a tile from block.layer - 1 to block.layer; its integers are kept. The models of the layer must be there.
   * @param cube of the tile: the same in every call
   */
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

  /**
   * Values of a tile, in fresh arrays that may be transferred.
   * @param eye camera centre, which only the anchor profile looks at; the origin of the header without it
   */
  values(tile: number, eye?: Point): TileValues {
    const { origin } = this.#opened();
    const state = this.#state(tile);
    const [x, y, z] = eye ?? origin;
    const layer = this.module.call((f) => f.scar_tile_layer(state));
    const at = this.module.call((f) => f.scar_gaussians(this.module.scar, state, x, y, z, 1));
    return { tile, layer, ...takeGaussians(this.module, at) };
  }

  /** The same in words. */
  packed(tile: number, eye?: Point): PackedTile {
    const [x, y, z] = eye ?? this.#opened().origin;
    const state = this.#state(tile);
    const layer = this.module.call((f) => f.scar_tile_layer(state));
    const at = this.module.call((f) => f.scar_words(this.module.scar, state, x, y, z));
    return { tile, layer, ...takeWords(this.module, at) };
  }

  /** Forgets the integers of a tile. It may be advanced again from layer 1. */
  release(tile: number): void {
    const state = this.#tiles.get(tile);
    if (state === undefined) return;
    this.#tiles.delete(tile);
    this.module.call((f) => f.scar_release(state));
  }

  /** Bytes held for tiles and models. */
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

/** The struct Words of scarfmt/native/wasm/words.c: two numbers, then addresses. */
function takeWords(module: WasmModule, at: Address): Omit<PackedTile, "tile" | "layer"> {
  const [count, shDegree, geometry, harmonics] = module.numbers(Uint32Array, at, 4);
  const words = (address: number, width: number) => module.numbers(Uint32Array, address, width * count);
  return { count, shDegree, geometry: words(geometry, 8), harmonics: words(harmonics, 4 * shDegree) };
}

/** The struct Gaussians of scarfmt/native/scar.h: two numbers, then addresses. */
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

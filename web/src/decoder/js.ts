/** The decoder written in JavaScript: the fall-back where WebAssembly has no SIMD, and what the fast one is held to. */

import { PROFILE, STREAM } from "../../../conformance/decoders/js/constants.js";
import { findBlock } from "../../../conformance/decoders/js/container.js";
import { openScar, Scar } from "../../../conformance/decoders/js/decoder.js";
import { Refused } from "../../../conformance/decoders/js/errors.js";
import { IndexNetwork } from "../../../conformance/decoders/js/index_network.js";
import { Tile } from "../../../conformance/decoders/js/tile.js";
import { packWords } from "../pack/words.js";
import { SparseSource } from "./sparse.js";
import type { Block, PackedTile, PackTarget, Point, TileDecoder, TileValues } from "./types.js";

type Models = ReturnType<Scar["models"]>;

/** Y_0 of SPEC §9.4. */
const SH_0 = 0.28209479177387814;
const FILE_LENGTH_AT = 16;
const HEADER_LEAST = 24;

/** A decoder that runs on the calling thread. */
export async function createJsDecoder(): Promise<TileDecoder> {
  return new JsDecoder();
}

class JsDecoder implements TileDecoder {
  readonly engine = "js";
  #scar: Scar | null = null;
  #source = new SparseSource(0);
  #models: Models | null = null;
  #network: IndexNetwork | null = null;
  readonly #tiles = new Map<number, Tile>();

  open(front: Uint8Array): void {
    if (this.#scar !== null) throw new RangeError("a decoder serves one file");
    const view = new DataView(front.buffer, front.byteOffset, front.byteLength);
    const whole = front.length < HEADER_LEAST ? front.length : Number(view.getBigUint64(FILE_LENGTH_AT, true));
    this.#source = new SparseSource(whole);
    this.#source.put(0, front);
    this.#scar = openScar(this.#source);
  }

  addModels(layer: number, blocks: Block[]): void {
    const scar = this.#opened();
    if (layer !== (this.#models?.layers ?? 0) + 1) throw new RangeError(`models of layer ${layer} are not the next`);
    for (const { kind, tile, body } of blocks) {
      const e = findBlock(scar.container, layer, kind, tile);
      if (e < 0) throw new RangeError(`layer ${layer} has no block of kind ${kind}`);
      this.#source.put(scar.container.entries.offset[e], body);
    }
    this.#models = scar.models(layer);
    this.#network = this.#models.network === null ? null : new IndexNetwork(this.#models);
  }

  advance(tile: number, layer: number, body: Uint8Array): void {
    const scar = this.#opened();
    const models = this.#models;
    if (models === null || layer > models.layers) throw new RangeError(`no models of layer ${layer}`);
    if (!(tile >= 0 && tile < scar.header.tile_count)) throw new RangeError(`no tile ${tile}`);
    const state = this.#tiles.get(tile) ?? new Tile(scar.container, models, tile);
    if (layer !== state.layer + 1) throw new RangeError(`tile ${tile} is at layer ${state.layer}, not ${layer - 1}`);
    if (state.models !== models) state.extend(models);
    const e = findBlock(scar.container, layer, 16, tile);
    const offset = e < 0 ? -1 : scar.container.entries.offset[e];
    if (e >= 0) this.#source.put(offset, body);
    try {
      state.decodeLayer(layer, this.#network, null);
      this.#tiles.set(tile, state);
    } catch (error) {
      this.#tiles.delete(tile);
      throw error;
    } finally {
      this.#source.remove(offset);
    }
  }

  values(tile: number, eye?: Point): TileValues {
    const scar = this.#opened();
    const state = this.#tiles.get(tile);
    if (state === undefined) throw new RangeError(`tile ${tile} is not decoded`);
    return scar.header.profile === PROFILE.EXPLICIT ? explicitValues(scar, state) : bakedValues(scar, state, eye);
  }

  packed(tile: number, target: PackTarget, eye?: Point): PackedTile {
    if (target !== "words") throw new RangeError(`no target ${target}`);
    return packWords(this.values(tile, eye));
  }

  release(tile: number): void {
    this.#tiles.delete(tile);
  }

  memory(): number {
    let sum = this.#source.held;
    for (const { bytes } of this.#tiles.values()) sum += bytes;
    return sum;
  }

  #opened(): Scar {
    if (this.#scar === null) throw new RangeError("open comes first");
    return this.#scar;
  }
}

function explicitValues(scar: Scar, state: Tile): TileValues {
  const exact = scar.exactValues(state);
  const { rotation, opacity, sh } = scar.activatedValues(state, exact) as Record<string, Float64Array>;
  return {
    tile: state.number,
    layer: state.layer,
    count: state.size,
    centres: new Float32Array(exact.position),
    scales: (exact.values.get(STREAM.SCALE) ?? new Float32Array(0)).map(Math.exp),
    quats: new Float32Array(rotation),
    opacity: new Float32Array(opacity),
    sh: new Float32Array(sh),
    shDegree: scar.header.sh_degree,
  };
}

/** The Gaussians of all slots for a camera centre, opacity 0 where R-9.6-1 says that they are not drawn. */
function bakedValues(scar: Scar, state: Tile, eye?: Point): TileValues {
  const baked = scar.activatedValues(state, scar.exactValues(state), eye) as Record<string, Float64Array>;
  const { slotLayer } = state;
  return {
    tile: state.number,
    layer: state.layer,
    count: slotLayer.length,
    centres: new Float32Array(baked["gaussian.centre"]),
    scales: new Float32Array(baked["gaussian.scale"]),
    quats: new Float32Array(baked["gaussian.rotation"]),
    opacity: Float32Array.from(baked["gaussian.opacity"], (o, i) => (slotLayer[i] > 0 && o > 0 ? o : 0)),
    sh: Float32Array.from(baked["gaussian.colour"], (colour) => (colour - 0.5) / SH_0),
    shDegree: 0,
  };
}

/** Whether an error says what is wrong with a file. */
export function isRefusal(error: unknown): error is Refused {
  return error instanceof Refused;
}

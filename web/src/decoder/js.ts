/** The decoder written in JavaScript: the fall-back where WebAssembly has no SIMD, and what the fast one is held to. */

import { BLOCK, DEFAULT_LIMITS, NO_TILE, PROFILE, STREAM } from "../../../conformance/decoders/js/constants.js";
import {
  type Container,
  emptyEntries,
  type Entries,
  findBlock,
  putEntry,
  readFront,
  type Tiles,
} from "../../../conformance/decoders/js/container.js";
import { Scar } from "../../../conformance/decoders/js/decoder.js";
import { crc32 } from "../../../conformance/decoders/js/crc32.js";
import { Refused } from "../../../conformance/decoders/js/errors.js";
import { IndexNetwork } from "../../../conformance/decoders/js/index_network.js";
import { Tile } from "../../../conformance/decoders/js/tile.js";
import { packWords } from "../pack/words.js";
import { SparseSource, startOf } from "./sparse.js";
import type { Block, Cube, PackedTile, PackTarget, Point, TileBlock, TileDecoder, TileValues } from "./types.js";

type Models = ReturnType<Scar["models"]>;

/** Y_0 of SPEC §9.4. */
const SH_0 = 0.28209479177387814;
/** The only tile of the container that a tile is decoded with. */
const ALONE = 0;

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
    this.#source = startOf(front);
    this.#scar = new Scar(modelContainer(this.#source), DEFAULT_LIMITS);
  }

  addModels(layer: number, blocks: Block[]): void {
    const scar = this.#opened();
    if (layer !== (this.#models?.layers ?? 0) + 1) throw new RangeError(`models of layer ${layer} are not the next`);
    for (const { kind, body } of blocks) {
      const e = findBlock(scar.container, layer, kind);
      if (e < 0) throw new RangeError(`layer ${layer} has no block of kind ${kind}`);
      this.#source.put(scar.container.entries.offset[e], body);
    }
    this.#models = scar.models(layer);
    this.#network = this.#models.network === null ? null : new IndexNetwork(this.#models);
  }

  advance(tile: number, cube: Cube, block: TileBlock): void {
    const { layer, offset } = block;
    const scar = this.#opened();
    const models = this.#models;
    if (models === null || layer > models.layers) throw new RangeError(`no models of layer ${layer}`);
    if (!(tile >= 0 && tile < scar.header.tile_count)) throw new RangeError(`no tile ${tile}`);
    const container = tileContainer(scar.container, cube, block);
    const state = this.#tiles.get(tile) ?? new Tile(container, models, ALONE);
    if (layer !== state.layer + 1) throw new RangeError(`tile ${tile} is at layer ${state.layer}, not ${layer - 1}`);
    if (state.models !== models) state.extend(models);
    state.container = container;
    if (block.body.length > 0) this.#source.put(offset, block.body);
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
    return scar.header.profile === PROFILE.EXPLICIT ? explicitValues(scar, tile, state) : bakedValues(scar, tile, state, eye);
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

/** What ROOT says of blocks, without tiles. */
function modelContainer(source: SparseSource): Container {
  const { header, layers, root } = readFront(source, DEFAULT_LIMITS, false);
  const entries = emptyEntries(root.blocks.length);
  root.blocks.forEach((row, e) => putEntry(entries, e, { ...row, tile: NO_TILE }));
  return { source, header, layers, tiles: noTiles(0), entries };
}

function noTiles(count: number): Tiles {
  return { depth: new Uint8Array(count), shift: new Uint8Array(count), prefix: new BigUint64Array(count) };
}

/** One tile, and its block in one layer. */
function tileContainer(whole: Container, { depth, shift, prefix }: Cube, block: TileBlock): Container {
  const tiles = noTiles(1);
  tiles.depth[ALONE] = depth;
  tiles.shift[ALONE] = shift;
  tiles.prefix[ALONE] = prefix;
  const { layer, offset, count, body } = block;
  const entries: Entries = emptyEntries(body.length > 0 ? 1 : 0);
  const row = { kind: BLOCK.TILE, flags: 1, layer, tile: ALONE, offset, length: body.length, count, crc32: crc32(body) };
  if (body.length > 0) putEntry(entries, 0, row);
  return { ...whole, tiles, entries };
}

function explicitValues(scar: Scar, tile: number, state: Tile): TileValues {
  const exact = scar.exactValues(state);
  const { rotation, opacity, sh } = scar.activatedValues(state, exact) as Record<string, Float64Array>;
  return {
    tile,
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
function bakedValues(scar: Scar, tile: number, state: Tile, eye?: Point): TileValues {
  const baked = scar.activatedValues(state, scar.exactValues(state), eye) as Record<string, Float64Array>;
  const { slotLayer } = state;
  return {
    tile,
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

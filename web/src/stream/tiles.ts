/** What is known of each tile: layers decoded, layers shown, bodies that wait for their turn. */

import type { TileBlock } from "../decoder/types.js";
import type { FileIndex } from "../plan/types.js";
import type { Directory } from "../format/directory.js";

export class Tiles {
  readonly index: FileIndex;
  /** (tiles): layers that the decoder has. */
  readonly decoded: Uint8Array;
  /** (tiles): layers delivered; 0 where a tile is not shown. */
  readonly shown: Uint8Array;
  /** (tiles): layers that can be had at all; fewer where blocks are damaged. */
  readonly limit: Uint8Array;
  /** (tiles): layers that budgets allow. */
  readonly goal: Uint8Array;
  /** Layers whose models the decoders have. */
  models = 0;
  /** Bytes of all that was delivered and is shown. */
  shownBytes = 0;
  /** Gaussians of all that is shown. */
  shownSplats = 0;
  /** Anchors that decoders hold, to go on from. */
  anchorsHeld = 0;
  /** (tiles): bytes of what was delivered. */
  readonly #output: Float64Array;
  readonly #bodies = new Map<number, Uint8Array>();
  #waitingBytes = 0;

  /** @param keepsComplete whether decoders hold what has all its layers, too */
  constructor(
    readonly front: Directory,
    readonly keepsComplete: boolean,
  ) {
    this.index = front.index;
    const { tiles, layers } = front.index;
    this.decoded = new Uint8Array(tiles);
    this.shown = new Uint8Array(tiles);
    this.limit = new Uint8Array(tiles).fill(layers);
    this.goal = new Uint8Array(tiles).fill(layers);
    this.#output = new Float64Array(tiles);
  }

  /** Bytes of bodies that wait. */
  get waitingBytes(): number {
    return this.#waitingBytes;
  }

  /** A decoder took a tile to a layer; 0 where it no longer holds it. */
  setDecoded(tile: number, layer: number): void {
    const held = (k: number) =>
      k < this.index.layers || this.keepsComplete ? this.splats(tile, k) / this.index.slots : 0;
    this.anchorsHeld += held(layer) - held(this.decoded[tile]);
    this.decoded[tile] = layer;
  }

  /** A tile is shown after a layer, in so many bytes; 0 and 0 where it is taken away. */
  setShown(tile: number, layer: number, bytes: number): void {
    this.shownSplats += this.splats(tile, layer) - this.splats(tile, this.shown[tile]);
    this.shownBytes += bytes - this.#output[tile];
    this.shown[tile] = layer;
    this.#output[tile] = bytes;
  }

  put(tile: number, layer: number, body: Uint8Array): void {
    this.#bodies.set(this.#key(tile, layer), body);
    this.#waitingBytes += body.length;
  }

  /** Layers that a tile has or will have without another byte being fetched. */
  have(tile: number): number {
    let layer = Math.max(this.decoded[tile], this.#finished(tile) ? this.shown[tile] : 0);
    while (layer < this.limit[tile] && this.#isThere(tile, layer + 1)) layer++;
    return layer;
  }

  /** Whether a tile shows all that can be had of it. */
  #finished(tile: number): boolean {
    return this.shown[tile] === this.limit[tile];
  }

  /** (tiles), for a planner. */
  haveAll(): Uint8Array {
    return Uint8Array.from(this.shown, (_, tile) => this.have(tile));
  }

  /** A goal includes the layers after it in which the tile has no block, since they cost nothing. */
  setGoals(goal: Uint8Array): void {
    const { layers } = this.index;
    goal.forEach((layer, tile) => {
      while (layer > 0 && layer < layers && this.front.hasNoBlock(tile, layer + 1)) layer++;
      this.goal[tile] = layer;
    });
  }

  /** Whether a tile can be taken further now. */
  isReady(tile: number): boolean {
    const next = this.decoded[tile] + 1;
    if (this.#finished(tile) || !this.front.isPlaced(tile)) return false;
    return next <= this.#reach(tile) && this.#isThere(tile, next);
  }

  /** The layers that a tile can be taken through now, up to one, with their bodies, which are given away. */
  takeReady(tile: number, upTo: number): TileBlock[] {
    const layers: TileBlock[] = [];
    const reach = Math.min(this.#reach(tile), upTo);
    for (let layer = this.decoded[tile] + 1; layer <= reach && this.#isThere(tile, layer); layer++) {
      layers.push({ layer, count: this.front.appear(tile, layer), body: this.#take(tile, layer) });
    }
    return layers;
  }

  /** Drops the bodies of a tile beyond a layer. @returns entries that were dropped */
  dropBodies(tile: number, beyond: number): number[] {
    const dropped: number[] = [];
    for (let layer = beyond + 1; layer <= this.index.layers; layer++) {
      if (!this.#bodies.has(this.#key(tile, layer))) continue;
      this.#take(tile, layer);
      dropped.push(this.front.numbers.tileBlock(tile, layer));
    }
    return dropped;
  }

  /** Gaussians of a tile after a layer. */
  splats(tile: number, layer: number): number {
    const { layers, counts, slots } = this.index;
    let sum = 0;
    for (let k = 0; k < layer; k++) sum += counts[tile * layers + k];
    return sum * slots;
  }

  #reach(tile: number): number {
    return Math.min(this.models, this.limit[tile], this.goal[tile]);
  }

  /** A tile without a block in a layer has that layer as soon as it has models for it (R-7.1-6). */
  #isThere(tile: number, layer: number): boolean {
    const key = this.#key(tile, layer);
    return this.front.hasNoBlock(tile, layer) ? layer <= this.models : this.#bodies.has(key);
  }

  #take(tile: number, layer: number): Uint8Array {
    const key = this.#key(tile, layer);
    const body = this.#bodies.get(key) ?? new Uint8Array(0);
    this.#bodies.delete(key);
    this.#waitingBytes -= body.length;
    return body;
  }

  #key(tile: number, layer: number): number {
    return tile * this.index.layers + layer - 1;
  }
}

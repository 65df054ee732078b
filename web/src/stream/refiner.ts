/** The loop of a stream: plan, fetch, decode, deliver, and let go of what no longer fits. */

import { buffersOf, type Failure, type Output, type TileOutput } from "../decoder/protocol.js";
import type { Block } from "../decoder/types.js";
import { BLOCK, PROFILE } from "../format/registry.js";
import { parseStreaming } from "../format/streaming.js";
import type { Budgets, Camera, Planner, Step } from "../plan/types.js";
import type { RetryOptions } from "./backoff.js";
import { evictionOrder, goals } from "./budget.js";
import { type ErrorPlace, StreamError } from "./errors.js";
import { Ledger } from "./ledger.js";
import { MemoryModel } from "./memory.js";
import type { Meter } from "./meter.js";
import type { OpenedFront } from "./open_front.js";
import type { Pool } from "./pool.js";
import { Queue } from "./queue.js";
import type { ByteSource } from "./source.js";
import { Tiles } from "./tiles.js";
import { Transfers } from "./transfers.js";
import { Views } from "./views.js";
import { wantedEntries } from "./wanted.js";

export interface RefinerParts {
  source: ByteSource;
  opened: OpenedFront;
  pool: Pool;
  meter: Meter;
  planner: Planner;
  output: Output;
  retry: RetryOptions;
  budgets: Budgets;
  camera: Camera | null;
  events: RefinerEvents;
}

export interface RefinerEvents {
  onTile(tile: number, layer: number, output: TileOutput, took: number): void;
  onEvict(tile: number, layer: number): void;
  /** The block STREAMING has come. */
  onStreaming(): void;
  /** The block THUMBNAIL has come: a WebP, PNG or JPEG file. */
  onThumbnail(picture: Uint8Array): void;
  /** A block arrived. */
  onBytes(): void;
  onDone(): void;
  onRetry(error: StreamError, delayMs: number): void;
  onError(error: StreamError): void;
}

/** A larger thumbnail breaks R-7.15-1, bytes. */
const MOST_THUMBNAIL = 65_535;
/** Bodies that may wait for a decoder, bytes. */
const MOST_WAITING = 4 << 20;
/** Share of the budget that is left to data under way, and its largest value, bytes. */
const UNDER_WAY_SHARE = 1 / 8;
const MOST_UNDER_WAY = 2 << 20;
/** Plans that take longer, milliseconds, are made less often while pages come: after so many times as long. */
const SHORT_MS = 5;
const PAUSE = 4;

export class Refiner {
  readonly tiles: Tiles;
  readonly transfers: Transfers;
  readonly memory: MemoryModel;
  readonly #views: Views;
  readonly #models: Map<number, Uint8Array> = new Map();
  readonly #ready: Queue;
  readonly #busy = new Set<number>();
  readonly #ledger: Ledger;
  /** Entry of the block STREAMING, -1 where there is none. */
  readonly #streamingEntry: number;
  /** The same of THUMBNAIL. */
  readonly #thumbnailEntry: number;
  #budgets: Budgets;
  #ideal: Step[] = [];
  #victims: number[] = [];
  #loadingModels = false;
  #done = false;
  /** Whether a plan is about to be made. */
  #planning = false;
  #timer: ReturnType<typeof setTimeout> | undefined;
  #planMs = 0;
  #blocked = false;
  #closed = false;

  constructor(readonly parts: RefinerParts) {
    const { source, opened, output, meter, retry, budgets, camera, events } = parts;
    const { front } = opened;
    this.#budgets = budgets;
    // What depends on the view is made again from what decoders hold.
    this.tiles = new Tiles(front, front.header.profile !== PROFILE.EXPLICIT);
    this.memory = new MemoryModel(this.tiles, output);
    this.#ready = new Queue(front.index.tiles, front.index.layers);
    this.#ledger = new Ledger(front.index.tiles, this.memory);
    this.#views = new Views(front.index.boxes, camera);
    this.#streamingEntry = front.numbers.blockOfFirst(BLOCK.STREAMING);
    const thumbnail = front.numbers.blockOfFirst(BLOCK.THUMBNAIL);
    this.#thumbnailEntry = thumbnail >= 0 && front.entries.length[thumbnail] <= MOST_THUMBNAIL ? thumbnail : -1;
    const onBlock = (entry: number, body: Uint8Array) => this.#arrived(entry, body);
    const onDamaged = (entry: number) => this.#damaged(entry);
    const onIdle = () => this.#dispatch();
    const { onRetry, onError: onFailure } = events;
    this.transfers = new Transfers(source, front, meter, { onBlock, onDamaged, onRetry, onFailure, onIdle }, retry);
  }

  /** Bytes of memory in use, as decoders say. */
  get used(): number {
    return this.tiles.shownBytes + this.tiles.waitingBytes + this.transfers.underWay + this.parts.pool.memory;
  }

  /** What the last plan took, milliseconds. */
  get planMs(): number {
    return this.#planMs;
  }

  /** Fetches at once; decoders get the front first of all, and need not be ready. */
  start(): void {
    const { source, pool } = this.parts;
    const { front, bytes, body, rest, position, end } = this.parts.opened;
    this.transfers.alone = true;
    void pool.open(bytes).then((failure) => {
      this.transfers.alone = false;
      if (failure !== null && !this.#closed) this.#fatal(failure);
    });
    const isNeeded = (e: number) => {
      const part = front.numbers.partOf(e);
      return part.what !== "block" || part.block.kind < BLOCK.TILE || e === this.#streamingEntry;
    };
    const wants = source.ranged === false ? (e: number) => this.transfers.isWanted(e) : isNeeded;
    // What the body brings is not to be asked for a second time.
    this.transfers.hold(true);
    this.replan();
    this.transfers.adopt(body, rest, position, end, wants);
    this.#pace();
  }

  setView(camera: Camera): void {
    this.#views.camera = camera;
    this.#done = false;
    this.replan();
    this.#dispatch();
  }

  setBudgets(budgets: Budgets): void {
    this.#budgets = budgets;
    this.#done = false;
    this.replan();
    this.#makeRoom(0, 0);
    this.#dispatch();
  }

  /** Decides anew what to fetch. */
  replan(): void {
    if (this.#closed) return;
    const started = performance.now();
    this.#blocked = false;
    this.#setGoals();
    const steps = this.#plan(this.tiles.haveAll());
    const { goal, limit } = this.tiles;
    const wanted = steps.filter(({ tile, layer }) => layer <= goal[tile] && layer <= limit[tile]);
    const entries = wantedEntries(this.parts.opened.front, wanted, this.#streamingEntry, this.#thumbnailEntry);
    if (entries.some((e) => !this.transfers.hasArrived(e))) this.#done = false;
    this.transfers.want(entries);
    for (const tile of goal.keys()) this.#touch(tile);
    this.#planMs = performance.now() - started;
  }

  /** Decides anew once the present task is over. @param blocked whether the next tile may still not fit */
  #replanSoon(blocked = false): void {
    if (this.#planning) return;
    this.#planning = true;
    queueMicrotask(() => this.#replanNow(blocked));
  }

  /** Decides anew where pages came: they are many where plans take long. */
  #replanForPages(): void {
    if (this.#planMs < SHORT_MS) return this.#replanSoon();
    if (this.#planning) return;
    this.#planning = true;
    this.#timer = setTimeout(() => this.#replanNow(false), PAUSE * this.#planMs);
  }

  #replanNow(blocked: boolean): void {
    this.#planning = false;
    this.replan();
    this.#makeRoom(0, 0);
    this.#blocked = blocked;
    this.#dispatch();
  }

  resume(): void {
    this.transfers.resume();
  }

  close(): void {
    this.#closed = true;
    clearTimeout(this.#timer);
    this.transfers.close();
  }

  #plan(have: Uint8Array): Step[] {
    return this.parts.planner.plan(this.tiles.index, this.#views.camera, have);
  }

  #setGoals(): void {
    const { index, goal, limit } = this.tiles;
    this.#ideal = this.#plan(new Uint8Array(index.tiles));
    this.#ready.setPlan(this.#ideal);
    const { splats, bytes } = this.#budgets;
    const underWay = Math.min(bytes * UNDER_WAY_SHARE, MOST_UNDER_WAY);
    const room = { splats, bytes: bytes - this.memory.fixed - underWay };
    this.tiles.setGoals(goals(this.#ideal, index.tiles, this.memory, room));
    const held = this.tiles.shown.map((layer, tile) => Math.max(layer, this.tiles.decoded[tile]));
    this.#victims = evictionOrder(this.#ideal, held, goal).reverse();
    for (const tile of goal.keys()) {
      this.#dropBodies(tile, Math.min(goal[tile], limit[tile]));
      const now = this.#now(tile);
      this.#ledger.charge(tile, now, this.#ledger.isOnItsWay(tile, now) ? this.#target(tile) : now);
    }
  }

  #dropBodies(tile: number, beyond: number): void {
    for (const entry of this.tiles.dropBodies(tile, beyond)) this.transfers.forget(entry);
  }

  #arrived(entry: number, body: Uint8Array): void {
    if (this.#closed) return;
    const part = this.parts.opened.front.numbers.partOf(entry);
    if (part.what === "tile") {
      this.tiles.put(part.tile, part.layer, body);
      this.#touch(part.tile);
    } else if (part.what !== "block") {
      this.#openPage(entry, body);
    } else if (entry === this.#streamingEntry) {
      this.#takeStreaming(body);
    } else if (entry === this.#thumbnailEntry) {
      this.parts.events.onThumbnail(body);
    } else {
      this.#models.set(entry, body);
      void this.#loadModels();
    }
    this.#dispatch();
    this.parts.events.onBytes();
  }

  /** A block that breaks a rule, or is of another file, is passed over: plans do without. */
  #takeStreaming(body: Uint8Array): void {
    const { index } = this.tiles;
    try {
      const streaming = parseStreaming(body);
      if (streaming.tiles !== index.tiles) return;
      index.streaming = streaming;
    } catch {
      return;
    }
    this.parts.events.onStreaming();
    this.#replanSoon();
  }

  /** A page changes what there is to fetch. */
  #openPage(entry: number, body: Uint8Array): void {
    try {
      this.parts.opened.front.openPage(entry, body);
    } catch (refusal) {
      this.#fatal(refusal as Failure);
      return;
    }
    this.#replanForPages();
  }

  async #loadModels(): Promise<void> {
    if (this.#loadingModels) return;
    this.#loadingModels = true;
    const { numbers, index } = this.parts.opened.front;
    while (this.tiles.models < index.layers && !this.#closed) {
      const layer = this.tiles.models + 1;
      const found = numbers.blocksOf(layer).filter(({ block }) => block.kind < BLOCK.THUMBNAIL);
      if (found.some(({ entry }) => !this.#models.has(entry))) break;
      const blocks = found.map(({ entry, block }): Block => ({ kind: block.kind, body: this.#models.get(entry)! }));
      const before = this.parts.pool.memory;
      const failure = await this.parts.pool.models(layer, blocks);
      if (this.#closed) return;
      for (const { entry } of found) this.#models.delete(entry);
      if (failure !== null) {
        this.#limitAll(layer - 1);
        this.#report(failure, { layer }, layer === 1);
        break;
      }
      this.memory.addModels(this.parts.pool.memory - before);
      this.tiles.models = layer;
      for (const tile of this.tiles.shown.keys()) this.#touch(tile);
    }
    this.#loadingModels = false;
    this.#dispatch();
  }

  /** Puts a tile in the queue of the decoders if there is something to do. */
  #touch(tile: number): void {
    if (!this.#busy.has(tile) && (this.tiles.isReady(tile) || this.#isStale(tile))) this.#ready.add(tile);
  }

  /** Whether a tile looks otherwise from where the camera is now. */
  #isStale(tile: number): boolean {
    return this.tiles.keepsComplete && this.#views.isStale(tile, this.tiles.shown[tile]);
  }

  /** Gives decoders what they can do. */
  #dispatch(): void {
    if (this.#closed) return;
    for (const tile of this.#ready.inOrder(this.tiles.decoded)) {
      if (!this.parts.pool.hasFree) break;
      if (!this.parts.pool.isFree(tile)) continue;
      const refines = this.tiles.isReady(tile);
      if (!refines && !this.#isStale(tile)) {
        this.#ready.delete(tile);
        continue;
      }
      if (refines && !this.#fits(tile)) continue;
      this.#ready.delete(tile);
      void this.#decode(tile);
    }
    this.#pace();
    this.#finish();
  }

  /** Makes room for a tile on its way to its goal, where there is any to be had. */
  #fits(tile: number): boolean {
    const { bytes, splats } = this.#ledger.growth(tile, this.#now(tile), this.#target(tile));
    if ((bytes <= 0 && splats <= 0) || this.#makeRoom(bytes, splats)) return true;
    if (this.#blocked || this.#busy.size > 0) return false;
    // A tile costs more than was thought when goals were set: they are set again, once, with what was learnt.
    this.#blocked = true;
    this.#replanSoon(true);
    return false;
  }

  /** The layer that a tile takes memory for. */
  #now(tile: number): number {
    return Math.max(this.tiles.shown[tile], this.tiles.decoded[tile]);
  }

  #target(tile: number): number {
    return Math.min(this.tiles.goal[tile], this.tiles.limit[tile]);
  }

  #makeRoom(bytes: number, splats: number): boolean {
    const most = this.#budgets;
    const fits = () => {
      const besides = this.memory.fixed + this.tiles.waitingBytes + this.transfers.underWay;
      return this.#ledger.bytes + besides + bytes <= most.bytes && this.#ledger.splats + splats <= most.splats;
    };
    while (!fits()) {
      const victim = this.#victims.pop();
      if (victim === undefined) return false;
      if (!this.#busy.has(victim)) this.#evict(victim);
    }
    return true;
  }

  #evict(tile: number): void {
    const layer = this.tiles.shown[tile];
    this.parts.pool.release(tile);
    this.#forget(tile);
    this.tiles.setShown(tile, 0, 0);
    this.tiles.setDecoded(tile, 0);
    this.#ledger.charge(tile, 0, 0);
    this.#ready.delete(tile);
    if (layer > 0) this.parts.events.onEvict(tile, layer);
    if (this.tiles.goal[tile] > 0) this.#replanSoon();
  }

  /** All blocks of a tile are to be fetched again. */
  #forget(tile: number): void {
    const { layers } = this.tiles.index;
    this.tiles.dropBodies(tile, 0);
    for (let k = 0; k < layers; k++) {
      this.transfers.forget(this.parts.opened.front.numbers.tileBlock(tile, k + 1));
    }
  }

  async #decode(tile: number): Promise<void> {
    const { tiles } = this;
    const layers = tiles.takeReady(tile, this.#ready.turnEnd(tile, tiles.decoded));
    const layer = layers.at(-1)?.layer ?? tiles.decoded[tile];
    const last = layer === tiles.index.layers && !this.tiles.keepsComplete;
    this.#busy.add(tile);
    this.#ledger.charge(tile, this.#now(tile), this.#target(tile));
    const eye = this.#views.use(tile);
    const cube = tiles.front.cube(tile);
    const task = { tile, cube, layers, output: this.parts.output, eye, last };
    const { output, failure, took } = await this.parts.pool.run(task);
    if (this.#closed) return;
    this.#busy.delete(tile);
    if (failure !== null || output === null) {
      this.#refused(tile, failure);
    } else {
      tiles.setDecoded(tile, layer);
      this.memory.observe(this.parts.pool.memory, tiles.anchorsHeld);
      this.#deliver(tile, layer, output, took, layers.length === 0);
    }
    this.#ledger.charge(tile, this.#now(tile), this.#target(tile));
    // Decoders make tables of a layer when they first need them, which nobody knew of before.
    if (this.used > this.#budgets.bytes) this.#replanSoon();
    this.#touch(tile);
    this.#dispatch();
  }

  #deliver(tile: number, layer: number, output: TileOutput, took: number, again: boolean): void {
    if (layer < this.tiles.shown[tile] || (layer === this.tiles.shown[tile] && !again)) return;
    const bytes = buffersOf(output).reduce((sum, { byteLength }) => sum + byteLength, 0);
    this.tiles.setShown(tile, layer, bytes);
    this.parts.events.onTile(tile, layer, output, took);
  }

  /** A tile that a decoder refuses stays as it is shown; what it was made from is decoded again if that is less. */
  #refused(tile: number, failure: Failure | null): void {
    const { decoded, limit } = this.tiles;
    const layer = failure?.layer ?? decoded[tile] + 1;
    limit[tile] = Math.min(limit[tile], layer - 1);
    this.tiles.setDecoded(tile, 0);
    this.#forget(tile);
    if (failure !== null) this.#report(failure, { tile, layer }, false);
    this.replan();
  }

  #damaged(entry: number): void {
    const { numbers, entries } = this.parts.opened.front;
    const part = numbers.partOf(entry);
    const offset = entries.offset[entry];
    const place = { source: this.parts.source.name, offset, layer: "layer" in part ? part.layer : undefined };
    const damaged = (id: string, what: string, more: ErrorPlace = {}) =>
      new StreamError(id, `the ${what} at byte ${offset} arrived damaged each time`, { ...place, ...more });
    if (part.what === "tile") {
      this.#limitTile(part.tile, part.layer - 1);
      this.parts.events.onError(damaged("crc-mismatch", "block", { tile: part.tile }));
    } else if (part.what === "block") {
      if (part.block.kind < BLOCK.THUMBNAIL) this.#damagedModels(part.layer, damaged("crc-mismatch", "block"));
    } else {
      this.#limitPage(part.page, part.what === "rows" ? part.layer - 1 : 0);
      this.parts.events.onError(damaged("page-crc-mismatch", "page"));
    }
    this.#replanSoon();
  }

  #damagedModels(layer: number, error: StreamError): void {
    this.#limitAll(layer - 1);
    error.fatal = layer === 1;
    this.parts.events.onError(error);
  }

  /** Layers of a tile beyond one are not to be had. */
  #limitTile(tile: number, layer: number): void {
    const { limit } = this.tiles;
    limit[tile] = Math.min(limit[tile], layer);
    this.#dropBodies(tile, limit[tile]);
  }

  #limitPage(page: number, layer: number): void {
    const [first, end] = this.tiles.front.tilesOf(page);
    for (let tile = first; tile < end; tile++) this.#limitTile(tile, layer);
  }

  #limitAll(layer: number): void {
    const { limit } = this.tiles;
    limit.forEach((most, tile) => (limit[tile] = Math.min(most, layer)));
    this.#replanSoon();
  }

  #report({ id, message, offset }: Failure, place: { tile?: number; layer?: number }, fatal: boolean): void {
    const error = new StreamError(id ?? "worker", message, { source: this.parts.source.name, offset, ...place });
    error.fatal = fatal;
    this.parts.events.onError(error);
  }

  #fatal(failure: Failure): void {
    this.transfers.close();
    this.#report(failure, {}, true);
  }

  /** Holds transfers back while decoders are behind. Bodies that wait for other blocks do not count. */
  #pace(): void {
    const most = Math.min(MOST_WAITING, this.#budgets.bytes * UNDER_WAY_SHARE);
    const behind = this.#busy.size > 0 || (this.#ready.size > 0 && !this.#blocked);
    this.transfers.hold(behind && this.tiles.waitingBytes > most);
  }

  #finish(): void {
    const working = this.#busy.size > 0 || this.#loadingModels || this.#planning;
    if (this.#done || working || !this.transfers.idle) return;
    if (this.#ready.size > 0 && !this.#blocked) return;
    this.#done = true;
    this.parts.events.onDone();
  }
}

/** A scene that arrives: what a page works with. */

import { inlineChannel, type MakeChannel, workerChannel } from "../decoder/channel.js";
import type { Output, TileOutput } from "../decoder/protocol.js";
import { byView } from "../plan/by_view.js";
import type { Budgets, Camera, Planner } from "../plan/types.js";
import type { RetryOptions } from "./backoff.js";
import { Emitter } from "./emitter.js";
import { asStreamError, StreamError } from "./errors.js";
import type { Front } from "../format/directory.js";
import type { Streaming } from "../format/streaming.js";
import { type HttpOptions, HttpSource } from "./http_source.js";
import { Meter } from "./meter.js";
import { FRONT_SIZES, type FrontSizes, openFront, type OpenedFront } from "./open_front.js";
import { Pool } from "./pool.js";
import { Refiner, type RefinerEvents } from "./refiner.js";
import { RETRY, retrying } from "./retrying.js";
import { BlobSource, type ByteSource, type SourceLike } from "./source.js";

export interface StreamOptions extends Partial<HttpOptions>, Partial<FrontSizes> {
  /** Decides what to fetch first. `byView` unless given: by what the camera sees, in file order before the first view. */
  planner?: Planner;
  /** What tiles are delivered as: plain arrays unless given, or a viewer's words. */
  output?: Output;
  /** The first view; `setView` from the handler of "front" does the same. */
  camera?: Camera;
  /** An eighth of the memory of the device, at most 512 MiB, and any number of Gaussians unless given. */
  budgets?: Partial<Budgets>;
  /** Decoders side by side: one fewer than there are cores, at most 4, unless given. 0: on the calling thread. */
  workers?: number;
  /** Makes decoders in another way. */
  channel?: MakeChannel;
  retry?: Partial<RetryOptions>;
  /** Least milliseconds between two plans while the camera moves. */
  replanMs?: number;
}

/** A tile after a layer, in fresh arrays: they are the receiver's. */
export interface TileEvent {
  tile: number;
  layer: number;
  /** Gaussians now. Index i is the same one in every later event of the tile. */
  count: number;
  output: TileOutput;
}

export interface EvictEvent {
  tile: number;
  /** The layer that it was shown after. */
  layer: number;
}

export interface Progress {
  bytesRead: number;
  /** Bytes of the file. */
  bytes: number;
  /** By layer - 1: tiles shown after it or a later one. */
  tilesAtLayer: number[];
}

export interface Stats extends Progress {
  /** Bytes of blocks that were taken; the rest was gaps, or came again. */
  bytesUsed: number;
  requests: number;
  retries: number;
  /** Bytes a second that the connection brings. */
  throughput: number;
  /** Seconds to the first byte of a request. */
  delay: number;
  tilesShown: number;
  splatsShown: number;
  /** Bytes: delivered and shown, decoders, data under way. */
  memory: number;
  /** Milliseconds that decoders were busy, all together. */
  decodeMs: number;
  /** Milliseconds since the stream was made: front, first tile; null before. */
  frontAt: number | null;
  firstTileAt: number | null;
  /** By layer - 1: milliseconds until every tile was shown after it, null before. */
  layerAt: (number | null)[];
}

export interface StreamEvents {
  /** Header, layers and boxes are known. Before any tile. */
  front: Front;
  /** A tile is there, or finer than before. */
  tile: TileEvent;
  /** A tile is to be taken away: its memory is needed for others. */
  evict: EvictEvent;
  progress: Progress;
  /** The block STREAMING has come, and with it `index.streaming` of the front. */
  streaming: Streaming;
  /** A small picture of the scene, a WebP, PNG or JPEG file, as a rule before any tile. */
  thumbnail: Uint8Array;
  /** All that view and budgets allow is shown. */
  done: Stats;
  /** Something failed and is tried again. */
  retry: { error: StreamError; delayMs: number };
  /** What is shown stays. Where `fatal`, nothing more comes until `resume`. */
  error: StreamError;
}

const MIB = 1 << 20;
/** Milliseconds without a byte after which a request is given up, unless given. */
const STALL_MS = 10_000;
/** Of the memory of a device; browsers that tell it say 8 GB at most. */
const SHARE = 1 / 8;
const MOST_BYTES = 512 * MIB;
const REPLAN_MS = 100;
/** Of large scenes plans take long: they are made after so many times as long. */
const PAUSE = 4;
const MOST_WORKERS = 4;
/** Tiles that a worker is given before it has answered. */
const MOST_AHEAD = 2;

export class ScarStream {
  /** Resolves when the front is read; rejects with the error that the "error" event has, too. */
  readonly ready: Promise<Front>;
  readonly #emitter = new Emitter<StreamEvents>();
  readonly #options: StreamOptions;
  readonly #controller = new AbortController();
  readonly #started = performance.now();
  readonly #meter = new Meter(() => performance.now());
  readonly #source: ByteSource;
  #budgets: Budgets;
  #camera: Camera | null;
  #pool: Pool | null = null;
  #refiner: Refiner | null = null;
  #front: Front | null = null;
  /** What ended the decoders. */
  #broken: StreamError | null = null;
  #planned = -Infinity;
  #timer: ReturnType<typeof setTimeout> | undefined;
  #read = { bytes: 0, requests: 0 };
  #marks: { frontAt: number | null; firstTileAt: number | null; layerAt: (number | null)[] };
  #tilesAtLayer: number[] = [];
  /** (tiles): layers shown. */
  #layers = new Uint8Array(0);
  #decodeMs = 0;

  /** Begins at once; handlers that are added in the same turn miss nothing. Throws StreamError for no source. */
  constructor(source: SourceLike, options: StreamOptions = {}) {
    this.#options = options;
    this.#budgets = { splats: Infinity, bytes: defaultBytes(), ...options.budgets };
    this.#camera = options.camera ?? null;
    this.#marks = { frontAt: null, firstTileAt: null, layerAt: [] };
    this.#source = makeSource(source, { ...options, stallMs: options.stallMs ?? STALL_MS });
    this.ready = this.#open();
    // A page that listens to "error" need not look at the promise.
    this.ready.catch(() => undefined);
  }

  /** What the front says, null before it is read. */
  get front(): Front | null {
    return this.#front;
  }

  /** Whether the server answers with ranges, so that what is not asked for is not sent; null before its first answer. */
  get ranged(): boolean | null {
    return this.#source.ranged;
  }

  /** @returns what takes the handler away again */
  on<Name extends keyof StreamEvents>(name: Name, handler: (event: StreamEvents[Name]) => void): () => void {
    return this.#emitter.on(name, handler);
  }

  /** Plans for another view: at once, or soon where that was done a moment ago. */
  setView(camera: Camera): void {
    this.#camera = camera;
    if (this.#refiner === null || this.#timer !== undefined || this.#controller.signal.aborted) return;
    const pause = Math.max(this.#options.replanMs ?? REPLAN_MS, PAUSE * this.#refiner.planMs);
    const wait = this.#planned + pause - performance.now();
    if (wait <= 0) this.#replan();
    else this.#timer = setTimeout(() => this.#replan(), wait);
  }

  /** What may be kept. */
  get budgets(): Budgets {
    return this.#budgets;
  }

  /** Changes what may be kept; what no longer fits is evicted. */
  setBudget(budgets: Partial<Budgets>): void {
    this.#budgets = { ...this.#budgets, ...budgets };
    this.#refiner?.setBudgets(this.#budgets);
  }

  /** Tries again after a fatal error of transport. Without a front, make another stream. */
  resume(): void {
    this.#refiner?.resume();
  }

  stats(): Stats {
    const refiner = this.#refiner;
    const counts = refiner?.transfers.counts;
    const { capacity: throughput, delay } = this.#meter;
    return {
      ...this.#progress(),
      bytesUsed: counts?.bytesUsed ?? 0,
      requests: this.#read.requests + (counts?.requests ?? 0),
      retries: counts?.retries ?? 0,
      throughput,
      delay,
      tilesShown: this.#tilesAtLayer[0] ?? 0,
      splatsShown: refiner?.tiles.shownSplats ?? 0,
      memory: refiner?.used ?? 0,
      decodeMs: this.#decodeMs,
      ...this.#marks,
      layerAt: [...this.#marks.layerAt],
    };
  }

  /** Ends everything: requests, workers, timers, events. */
  close(): void {
    this.#controller.abort(new DOMException("the stream was closed", "AbortError"));
    clearTimeout(this.#timer);
    this.#refiner?.close();
    this.#pool?.close();
    this.#emitter.clear();
  }

  async #open(): Promise<Front> {
    const { signal } = this.#controller;
    try {
      // Handlers are added after the constructor.
      await Promise.resolve();
      signal.throwIfAborted();
      // Decoders load while the first bytes come.
      this.#pool = this.#makePool();
      const opened = await this.#openRetrying();
      // The page has its turn: to read a front and to plan for it takes too long for one task.
      await new Promise((resolve) => setTimeout(resolve));
      signal.throwIfAborted();
      if (this.#broken !== null) throw this.#broken;
      return this.#begin(opened, this.#pool);
    } catch (cause) {
      this.#pool?.close();
      if (signal.aborted) throw signal.reason;
      const error = asStreamError(cause, { source: this.#source.name });
      error.fatal = true;
      this.#emitter.emit("error", error);
      throw error;
    }
  }

  #openRetrying(): Promise<OpenedFront> {
    const { signal } = this.#controller;
    const { firstBytes = FRONT_SIZES.firstBytes, frontBytes = FRONT_SIZES.frontBytes } = this.#options;
    return retrying(() => openFront(this.#source, signal, { firstBytes, frontBytes }), {
      signal,
      source: this.#source.name,
      retry: this.#retry,
      onRetry: (error, delayMs) => this.#emitter.emit("retry", { error, delayMs }),
    });
  }

  #begin(opened: OpenedFront, pool: Pool): Front {
    const { front } = opened;
    this.#front = front;
    this.#read = { bytes: opened.read, requests: opened.requests };
    this.#marks.frontAt = this.#elapsed();
    this.#marks.layerAt = Array.from({ length: front.index.layers }, () => null);
    this.#tilesAtLayer = Array.from({ length: front.index.layers }, () => 0);
    this.#layers = new Uint8Array(front.index.tiles);
    this.#emitter.emit("front", front);
    // Who sees the front may close the stream there and then.
    this.#controller.signal.throwIfAborted();
    this.#refiner = new Refiner({
      source: this.#source,
      opened,
      pool,
      meter: this.#meter,
      planner: this.#options.planner ?? byView,
      output: this.#options.output ?? "values",
      retry: this.#retry,
      budgets: this.#budgets,
      camera: this.#camera,
      events: this.#handlers(front),
    });
    this.#planned = performance.now();
    this.#refiner.start();
    return front;
  }

  #makePool(): Pool {
    const { channel, workers = defaultWorkers() } = this.#options;
    const make = channel ?? (workers === 0 ? inlineChannel() : workerChannel);
    // On the calling thread tiles would only be decoded at one go, and keep that thread the longer.
    return new Pool(Math.max(workers, 1), make, (error) => this.#fail(error), workers === 0 ? 1 : MOST_AHEAD);
  }

  #handlers(front: Front): RefinerEvents {
    const { index } = front;
    return {
      onTile: (tile, layer, output, took) => {
        this.#decodeMs += took;
        this.#mark(tile, layer, index.tiles);
        this.#emitter.emit("tile", { tile, layer, count: output.count, output });
      },
      onEvict: (tile, layer) => {
        for (let k = 0; k < layer; k++) this.#tilesAtLayer[k]--;
        this.#layers[tile] = 0;
        this.#emitter.emit("evict", { tile, layer });
      },
      onStreaming: () => index.streaming !== null && this.#emitter.emit("streaming", index.streaming),
      onThumbnail: (picture) => this.#emitter.emit("thumbnail", picture),
      onBytes: () => this.#emitter.emit("progress", this.#progress()),
      onDone: () => this.#emitter.emit("done", this.stats()),
      onRetry: (error, delayMs) => this.#emitter.emit("retry", { error, delayMs }),
      onError: (error) => this.#emitter.emit("error", error),
    };
  }

  #mark(tile: number, layer: number, tiles: number): void {
    const { layerAt } = this.#marks;
    this.#marks.firstTileAt ??= this.#elapsed();
    for (let k = this.#layers[tile]; k < layer; k++) {
      this.#tilesAtLayer[k]++;
      if (this.#tilesAtLayer[k] === tiles) layerAt[k] ??= this.#elapsed();
    }
    this.#layers[tile] = layer;
  }

  #progress(): Progress {
    const bytesRead = this.#read.bytes + (this.#refiner?.transfers.counts.bytesRead ?? 0);
    const bytes = this.#front?.header.file_length ?? 0;
    return { bytesRead, bytes, tilesAtLayer: [...this.#tilesAtLayer] };
  }

  #replan(): void {
    clearTimeout(this.#timer);
    this.#timer = undefined;
    this.#planned = performance.now();
    if (this.#camera !== null) this.#refiner?.setView(this.#camera);
  }

  #fail(error: StreamError): void {
    if (this.#controller.signal.aborted) return;
    this.#broken ??= error;
    // Who waits for the front is told then.
    if (this.#refiner === null) return;
    error.fatal = true;
    this.#refiner.close();
    this.#emitter.emit("error", error);
  }

  #elapsed(): number {
    return performance.now() - this.#started;
  }

  get #retry(): RetryOptions {
    return { ...RETRY, ...this.#options.retry };
  }
}

function makeSource(source: SourceLike, options: HttpOptions): ByteSource {
  if (typeof source === "string" || source instanceof URL) return new HttpSource(String(source), options);
  if (typeof Blob !== "undefined" && source instanceof Blob) return new BlobSource(source);
  throw new StreamError("bad-source", "a source is a URL, a File or a Blob");
}

/** Safari and Firefox do not tell the memory of a device. */
function defaultBytes(): number {
  const { deviceMemory = Infinity } = (globalThis.navigator ?? {}) as { deviceMemory?: number };
  return Math.min(SHARE * 1024 * MIB * deviceMemory, MOST_BYTES);
}

function defaultWorkers(): number {
  if (typeof Worker === "undefined") return 0;
  return Math.min(Math.max((navigator.hardwareConcurrency ?? 2) - 1, 1), MOST_WORKERS);
}

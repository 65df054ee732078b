/** A scene of several files that arrives (SPEC §17): a stream for each file that is looked at. */

import type { TileOutput } from "../decoder/protocol.js";
import type { Budgets, Camera } from "../plan/types.js";
import { Emitter } from "../stream/emitter.js";
import { asStreamError, type StreamError } from "../stream/errors.js";
import { RETRY } from "../stream/retrying.js";
import { BUDGETS, defaultWorkers, ScarStream, type Stats, type StreamOptions } from "../stream/scar_stream.js";
import { makeSource, STALL_MS, type SourceLike } from "../stream/source.js";
import { beside, readIndex, type Resolve } from "./index_file.js";
import { cameraIn } from "./placement.js";
import { difference, type SceneFront, sceneFront } from "./scene_front.js";
import { OPEN_BYTES, type Share, shares } from "./shares.js";

export interface SceneOptions extends StreamOptions {
  /** Gives the file of a `uri`; beside the index where that has an address. */
  resolve?: Resolve;
}

/** A tile of a file of the scene, after a layer. */
export interface SceneTileEvent {
  /** Place of the file in the index; its placement is not applied. */
  file: number;
  tile: number;
  layer: number;
  count: number;
  output: TileOutput;
}

export interface SceneEvents {
  /** The index is read. Before any tile. */
  front: SceneFront;
  tile: SceneTileEvent;
  evict: { file: number; tile: number };
  progress: { bytesRead: number; bytes: number };
  /** All that view and budgets allow is shown. */
  done: Stats;
  retry: { error: StreamError; delayMs: number };
  /** Where not `fatal`, it is of one file, and others go on. */
  error: StreamError;
}

interface Opened {
  stream: ScarStream;
  /** Tiles shown, and after which layer. */
  shown: Map<number, number>;
  /** Whether its first tile is still to come. */
  opening: boolean;
  done: boolean;
  budgets: Budgets;
}

/** What statistics of files add up to, those that were closed included. */
type Sums = Pick<Stats, "bytesRead" | "bytesUsed" | "requests" | "retries" | "aborted" | "evictions" | "decodeMs">;
const NO_SUMS: Sums = { bytesRead: 0, bytesUsed: 0, requests: 0, retries: 0, aborted: 0, evictions: 0, decodeMs: 0 };

function added(sums: Sums, stats: Stats): Sums {
  const names = Object.keys(sums) as (keyof Sums)[];
  return Object.fromEntries(names.map((name) => [name, sums[name] + stats[name]])) as unknown as Sums;
}

const MOST_OPEN = 16;
/** Files whose first tile is awaited at once. */
const MOST_OPENING = 2;
/** Files share the workers of a page. */
const SHARING = 4;
const RESHARE_MS = 200;
/** More than so much larger, a budget is told to its stream: each time it plans anew. */
const LARGER = 1.05;

export class ScarScene {
  /** Resolves when the index is read; rejects with the error that the "error" event has, too. */
  readonly ready: Promise<SceneFront>;
  readonly #emitter = new Emitter<SceneEvents>();
  readonly #controller = new AbortController();
  readonly #started = performance.now();
  readonly #open = new Map<number, Opened>();
  /** Files that are not opened again until `resume`. */
  readonly #failed = new Set<number>();
  readonly #resolve: Resolve;
  #front: SceneFront | null = null;
  #camera: Camera | null;
  #budgets: Budgets;
  #shares: Share[] = [];
  #shared = -Infinity;
  #timer: ReturnType<typeof setTimeout> | undefined;
  /** Of files that were closed. */
  #before = NO_SUMS;
  #frontAt: number | null = null;
  #firstTileAt: number | null = null;

  /** Begins at once; handlers that are added in the same turn miss nothing. Throws StreamError for no source. */
  constructor(
    index: SourceLike,
    readonly options: SceneOptions = {},
  ) {
    const source = makeSource(index, { ...options, stallMs: options.stallMs ?? STALL_MS });
    this.#camera = options.camera ?? null;
    this.#budgets = { ...BUDGETS, ...options.budgets };
    this.#resolve = options.resolve ?? beside(source.name);
    this.ready = this.#read(source);
    this.ready.catch(() => undefined);
  }

  get front(): SceneFront | null {
    return this.#front;
  }

  get budgets(): Budgets {
    return this.#budgets;
  }

  /** @returns what takes the handler away again */
  on<Name extends keyof SceneEvents>(name: Name, handler: (event: SceneEvents[Name]) => void): () => void {
    return this.#emitter.on(name, handler);
  }

  /** Files that are open, in the order of their use. */
  get files(): number[] {
    return this.#shares.map(({ file }) => file).filter((file) => this.#open.has(file));
  }

  setView(camera: Camera): void {
    this.#camera = camera;
    for (const [file, opened] of this.#open) {
      opened.done = false;
      opened.stream.setView(this.#cameraOf(file, camera));
    }
    if (this.#timer !== undefined || this.#controller.signal.aborted) return;
    const wait = this.#shared + RESHARE_MS - performance.now();
    if (wait <= 0) this.#share();
    else this.#timer = setTimeout(() => this.#share(), wait);
  }

  setBudget(budgets: Partial<Budgets>): void {
    this.#budgets = { ...this.#budgets, ...budgets };
    this.#share();
  }

  /** Tries again: streams that failed, and files that could not be opened. */
  resume(): void {
    this.#failed.clear();
    for (const { stream } of this.#open.values()) stream.resume();
    this.#share();
  }

  /** Sums over files; times and layers are of the scene. */
  stats(): Stats {
    const each = [...this.#open.values()].map(({ stream }) => stream.stats());
    const sum = (name: "splatsShown" | "memory" | "tilesShown" | "throughput") =>
      each.reduce((total, one) => total + one[name], 0);
    return {
      ...each.reduce(added, this.#before),
      bytes: this.#front?.header.file_length ?? 0,
      throughput: sum("throughput"),
      delay: Math.max(0, ...each.map(({ delay }) => delay)),
      tilesShown: sum("tilesShown"),
      splatsShown: sum("splatsShown"),
      memory: sum("memory"),
      engine: each.find(({ engine }) => engine !== null)?.engine ?? null,
      tilesAtLayer: this.#filesAtLayer(),
      frontAt: this.#frontAt,
      firstTileAt: this.#firstTileAt,
      layerAt: (this.#front?.layers ?? []).map(() => null),
    };
  }

  close(): void {
    this.#controller.abort(new DOMException("the scene was closed", "AbortError"));
    clearTimeout(this.#timer);
    for (const { stream } of this.#open.values()) stream.close();
    this.#open.clear();
    this.#emitter.clear();
  }

  async #read(source: ReturnType<typeof makeSource>): Promise<SceneFront> {
    const { signal } = this.#controller;
    try {
      // Handlers are added after the constructor.
      await Promise.resolve();
      signal.throwIfAborted();
      const onRetry = (error: StreamError, delayMs: number) => this.#emitter.emit("retry", { error, delayMs });
      const retry = { ...RETRY, ...this.options.retry };
      const document = await readIndex(source, { signal, source: source.name, retry, onRetry });
      signal.throwIfAborted();
      const front = sceneFront(document);
      this.#front = front;
      this.#frontAt = performance.now() - this.#started;
      this.#emitter.emit("front", front);
      signal.throwIfAborted();
      this.#share();
      return front;
    } catch (cause) {
      if (signal.aborted) throw signal.reason;
      const error = asStreamError(cause, { source: source.name });
      error.fatal = true;
      this.#emitter.emit("error", error);
      throw error;
    }
  }

  /** Decides anew which files are open, and what each may use. */
  #share(): void {
    clearTimeout(this.#timer);
    this.#timer = undefined;
    if (this.#front === null || this.#controller.signal.aborted) return;
    this.#shared = performance.now();
    const { document, index } = this.#front;
    const most = Math.max(1, Math.min(MOST_OPEN, Math.floor(this.#budgets.bytes / (2 * OPEN_BYTES))));
    this.#shares = shares(document.files, index.boxes, this.#camera, this.#budgets, most);
    const wanted = new Set(this.#shares.map(({ file }) => file));
    for (const file of [...this.#open.keys()]) if (!wanted.has(file)) this.#closeFile(file);
    // What is taken from some is given to others only then.
    for (const larger of [false, true]) {
      for (const { file, budgets } of this.#shares) this.#setBudget(file, budgets, larger);
    }
    this.#openMore();
  }

  #setBudget(file: number, budgets: Budgets, larger: boolean): void {
    const opened = this.#open.get(file);
    if (opened === undefined) return;
    const { splats, bytes } = opened.budgets;
    const shrinks = budgets.splats < splats || budgets.bytes < bytes;
    const grows = budgets.splats > LARGER * splats || budgets.bytes > LARGER * bytes;
    if (larger ? !grows || shrinks : !shrinks) return;
    opened.budgets = budgets;
    opened.done = false;
    opened.stream.setBudget(budgets);
  }

  /** Opens files in the order of their use, a few at once, so that those in front are seen first. */
  #openMore(): void {
    let opening = [...this.#open.values()].filter((one) => one.opening).length;
    for (const { file, budgets } of this.#shares) {
      if (opening >= MOST_OPENING) break;
      if (this.#open.has(file) || this.#failed.has(file)) continue;
      this.#openFile(file, budgets);
      opening++;
    }
    this.#finish();
  }

  #openFile(file: number, budgets: Budgets): void {
    const { document } = this.#front!;
    const { uri } = document.files[file];
    const camera = this.#camera === null ? undefined : this.#cameraOf(file, this.#camera);
    const workers = this.options.workers ?? defaultWorkers();
    const shared = workers === 0 ? 0 : Math.max(1, Math.ceil(workers / Math.min(document.files.length, SHARING)));
    try {
      const stream = new ScarStream(this.#resolve(uri), { ...this.options, camera, budgets, workers: shared });
      const opened: Opened = { stream, shown: new Map(), opening: true, done: false, budgets };
      this.#open.set(file, opened);
      this.#listen(file, opened);
    } catch (cause) {
      this.#fail(file, asStreamError(cause, { source: uri }));
    }
  }

  #listen(file: number, opened: Opened): void {
    const { stream, shown } = opened;
    const settled = () => {
      if (!opened.opening) return;
      opened.opening = false;
      this.#openMore();
    };
    stream.on("front", (front) => {
      const { document } = this.#front!;
      const wrong = difference(document, document.files[file], front);
      if (wrong !== null) this.#fail(file, wrong);
    });
    stream.on("tile", ({ tile, layer, count, output }) => {
      shown.set(tile, layer);
      this.#firstTileAt ??= performance.now() - this.#started;
      this.#emitter.emit("tile", { file, tile, layer, count, output });
      settled();
    });
    stream.on("evict", ({ tile }) => {
      shown.delete(tile);
      this.#emitter.emit("evict", { file, tile });
    });
    stream.on("progress", () => {
      opened.done = false;
      const { bytesRead, bytes } = this.stats();
      this.#emitter.emit("progress", { bytesRead, bytes });
    });
    stream.on("done", () => {
      opened.done = true;
      settled();
      this.#finish();
    });
    stream.on("retry", (event) => this.#emitter.emit("retry", event));
    stream.on("error", (error) => {
      if (error.fatal) this.#fail(file, error);
      else this.#emitter.emit("error", error);
    });
  }

  /** A file that failed stays as it is shown; one of which nothing was read is closed. */
  #fail(file: number, error: StreamError): void {
    if (this.#failed.has(file)) return;
    this.#failed.add(file);
    const opened = this.#open.get(file);
    if (opened?.opening === true) this.#closeFile(file);
    else if (opened !== undefined) opened.done = true;
    error.fatal = this.#front!.document.files.length === this.#failed.size;
    this.#emitter.emit("error", error);
    queueMicrotask(() => this.#openMore());
  }

  #closeFile(file: number): void {
    const { stream, shown } = this.#open.get(file)!;
    this.#before = added(this.#before, stream.stats());
    stream.close();
    this.#open.delete(file);
    for (const tile of shown.keys()) this.#emitter.emit("evict", { file, tile });
  }

  #finish(): void {
    if (this.#controller.signal.aborted) return;
    const waits = this.#shares.some(({ file }) => !this.#failed.has(file) && !this.#open.get(file)?.done);
    if (!waits && this.#timer === undefined) this.#emitter.emit("done", this.stats());
  }

  /** By layer - 1: files shown after it, those in part as the part of their tiles. */
  #filesAtLayer(): number[] {
    return (this.#front?.layers ?? []).map((_, k) => {
      let sum = 0;
      for (const [file, { stream, shown }] of this.#open) {
        const { length } = this.#front!.document.files[file].layers;
        const reached = [...shown.values()].filter((layer) => layer >= Math.min(k + 1, length)).length;
        sum += reached / Math.max(stream.front?.index.tiles ?? 1, 1);
      }
      return sum;
    });
  }

  #cameraOf(file: number, camera: Camera): Camera {
    return cameraIn(this.#front!.document.files[file].placement, camera);
  }
}

/** A scene on its way to what draws it: how much of it is wanted, beginning anew, and what came early. */

import type { PackedTile } from "../decoder/types.js";
import type { Front } from "../format/directory.js";
import { byView } from "../plan/by_view.js";
import { outsideView, type View, viewOfFile } from "../plan/framing.js";
import type { Budgets, Camera } from "../plan/types.js";
import { Emitter } from "./emitter.js";
import type { StreamError } from "./errors.js";
import { Looking } from "./looking.js";
import { ScarStream, type Stats, type StreamOptions } from "./scar_stream.js";
import type { SourceLike } from "./source.js";

/** Of a stream, but for what a feed decides. */
export type FeedOptions = Omit<StreamOptions, "output" | "planner" | "camera"> & {
  /** Layers, from the first; all unless given. */
  layers?: number;
};

/** What draws tiles. */
export interface Sink {
  /** Makes room; what was there is gone. */
  open(front: Front, budgets: Budgets): void;
  put(words: PackedTile): void;
  remove(tile: number): void;
}

export interface FeedEvents {
  /** Header, layers and boxes are known. */
  front: Front;
  /** Where to look from first: from outside, and what the file says once that has come. */
  opening: View;
  /** A small picture of the scene, as a rule before any tile. */
  thumbnail: Uint8Array;
  /** A tile of layer 1, while nothing draws the scene. */
  early: PackedTile;
  /** Something has come, went, or is asked for. */
  change: null;
  retry: StreamError;
  error: StreamError;
}

export class Feed {
  front: Front | null = null;
  /** Where to look from first, null before the front. */
  opening: View | null = null;
  /** Whether all that is wanted has come. */
  done = false;
  /** Whether layer 1 is all there, as far as it can be. */
  begun = false;
  error: StreamError | null = null;
  readonly #emitter = new Emitter<FeedEvents>();
  readonly #looking = new Looking((camera) => this.#setView(camera));
  #stream: ScarStream;
  #sink: Sink | null = null;
  #layers: number;
  #camera: Camera | undefined;
  /** Tiles that came before there was a sink. */
  readonly #early = new Map<number, PackedTile>();

  /** Begins at once. */
  constructor(
    readonly source: SourceLike,
    private readonly options: FeedOptions = {},
  ) {
    this.#layers = options.layers ?? Infinity;
    this.#stream = this.#open();
  }

  /** @returns what takes the handler away again */
  on<Name extends keyof FeedEvents>(name: Name, handler: (event: FeedEvents[Name]) => void): () => void {
    return this.#emitter.on(name, handler);
  }

  /** Gives all to a sink from now on, and what has come already at once. Before, only layer 1 is asked for. */
  drawOn(sink: Sink): void {
    this.#sink = sink;
    if (this.front !== null) sink.open(this.front, this.#stream.budgets);
    for (const words of this.#early.values()) sink.put(words);
    this.#early.clear();
    if (this.#camera !== undefined) this.#setView(this.#camera);
  }

  get layers(): number {
    return this.#layers;
  }

  /** Fewer begin anew: what is refined cannot be made coarse again. */
  set layers(layers: number) {
    const fewer = layers < this.#layers;
    this.#layers = layers;
    if (fewer) this.restart();
    else if (this.#camera !== undefined) this.#setView(this.#camera);
  }

  /** Plans for a camera, if that is another one. */
  look(camera: Camera): void {
    this.#looking.look(camera);
  }

  /** Reads on after an error of the connection, or from the start where nothing was read or the file may be another one. */
  again(): void {
    const anew = this.front === null || this.error?.id === "file-changed";
    this.error = null;
    if (anew) this.restart();
    else this.#stream.resume();
    this.#emitter.emit("change", null);
  }

  /** Reads all again: what was drawn is lost. */
  restart(): void {
    this.#stream.close();
    this.#early.clear();
    this.#stream = this.#open();
  }

  stats(): Stats {
    return this.#stream.stats();
  }

  close(): void {
    this.#stream.close();
    this.#emitter.clear();
  }

  #begin(view: View): void {
    this.opening = view;
    this.#emitter.emit("opening", view);
  }

  #setView(camera: Camera): void {
    this.done = false;
    this.#camera = camera;
    this.#stream.setView(camera);
  }

  #open(): ScarStream {
    this.done = false;
    this.begun = false;
    this.error = null;
    // Nobody sees later layers before there is something that draws: what draws is to be fetched first.
    const most = () => (this.#sink === null && this.#stream.ranged !== false ? 1 : this.#layers);
    const planner = {
      plan: (...asked: Parameters<typeof byView.plan>) => byView.plan(...asked).filter(({ layer }) => layer <= most()),
    };
    const stream = new ScarStream(this.source, { ...this.options, planner, camera: this.#camera, output: "words" });
    stream.on("front", (front) => {
      this.front = front;
      this.#sink?.open(front, stream.budgets);
      if (this.opening === null) this.#begin(outsideView(front));
      this.#emitter.emit("front", front);
    });
    stream.on("streaming", ({ view }) => view !== null && this.#begin(viewOfFile(view)));
    stream.on("thumbnail", (picture) => this.#emitter.emit("thumbnail", picture));
    stream.on("tile", ({ output }) => {
      const words = output as PackedTile;
      if (this.#sink !== null) {
        this.#sink.put(words);
      } else {
        this.#early.set(words.tile, words);
        this.#emitter.emit("early", words);
      }
      this.begun ||= stream.stats().layerAt[0] !== null;
      this.#emitter.emit("change", null);
    });
    stream.on("evict", ({ tile }) => {
      this.#early.delete(tile);
      this.#sink?.remove(tile);
      this.#emitter.emit("change", null);
    });
    stream.on("progress", () => this.#emitter.emit("change", null));
    stream.on("done", () => {
      this.done = this.#sink !== null;
      this.begun = true;
      this.#emitter.emit("change", null);
    });
    stream.on("retry", ({ error }) => this.#emitter.emit("retry", error));
    stream.on("error", (error) => {
      this.error = error;
      this.begun ||= error.fatal && this.front !== null;
      this.#emitter.emit("error", error);
    });
    return stream;
  }
}

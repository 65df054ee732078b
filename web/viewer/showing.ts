/** One scene on one stage: what it comes from, how much of it is wanted, and what has come. */

import type { PackedTile } from "../src/decoder/types.js";
import type { Front } from "../src/format/directory.js";
import { placesFor } from "../src/pack/places.js";
import { byView } from "../src/plan/by_view.js";
import type { Budgets, Camera } from "../src/plan/types.js";
import type { StreamError } from "../src/stream/errors.js";
import { ScarStream, type Stats } from "../src/stream/scar_stream.js";
import type { SourceLike } from "../src/stream/source.js";
import { type Frame, viewOfFile } from "./framing.js";
import type { Stage } from "./stage.js";

/** Where a scene comes from. */
export interface Origin {
  name: string;
  source: SourceLike;
}

export interface ShowingEvents {
  onFront(): void;
  /** The file names a view to begin with. */
  onView(view: Frame): void;
  /** Something is to be drawn or written on the page. */
  onChange(): void;
  onError(error: StreamError): void;
}

/** What of a scene is asked for. */
export interface Wish {
  /** Layers, from the first; Infinity for all. */
  layers: number;
  /** Degree of harmonics that is drawn. */
  degree: number;
}

/** Events of the document, for programs that watch the page: a stream that begins, and a tile on the GPU. */
const STREAM_BEGINS = "scar-stream";
const TILE_DRAWN = "scar-drawn";

export class Showing {
  /** Null until the drawing code is loaded. */
  stage: Stage | null = null;
  front: Front | null = null;
  done = false;
  error: StreamError | null = null;
  #stream: ScarStream;
  #camera: Camera | null = null;
  /** Tiles that came before there was a stage. */
  readonly #early = new Map<number, PackedTile>();

  constructor(
    readonly origin: Origin,
    readonly wish: Wish,
    private readonly events: ShowingEvents,
    private readonly budgets: Partial<Budgets>,
  ) {
    this.#stream = this.#open();
  }

  get name(): string {
    return this.origin.name;
  }

  /** Draws on a stage from now on, and what has come already at once. */
  drawOn(stage: Stage): void {
    this.stage = stage;
    stage.onLost = () => this.restart();
    stage.onWritten = ({ tile, layer }) => dispatch(TILE_DRAWN, { tile, layer });
    if (this.front !== null) this.#setUp(stage, this.front);
    for (const words of this.#early.values()) stage.put(words);
    this.#early.clear();
  }

  /** Asks for more or fewer layers. Fewer begin anew: what is refined cannot be made coarse again. */
  wishLayers(layers: number): void {
    const fewer = layers < this.wish.layers;
    this.wish.layers = layers;
    if (fewer) this.restart();
    else if (this.#camera !== null) this.setView(this.#camera);
  }

  wishDegree(degree: number): void {
    this.wish.degree = degree;
    this.stage?.showDegree(degree);
    this.events.onChange();
  }

  setView(camera: Camera): void {
    this.done = false;
    this.#camera = camera;
    this.#stream.setView(camera);
  }

  /** Reads on after an error of the connection, or from the start where nothing was read or the file may be another one. */
  again(): void {
    const anew = this.front === null || this.error?.id === "file-changed";
    this.error = null;
    if (anew) this.restart();
    else this.#stream.resume();
    this.events.onChange();
  }

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
    this.stage?.dispose();
  }

  #open(): ScarStream {
    this.done = false;
    this.error = null;
    const planner = {
      plan: (...asked: Parameters<typeof byView.plan>) => byView.plan(...asked).filter(({ layer }) => layer <= this.wish.layers),
    };
    const camera = this.#camera ?? undefined;
    const stream = new ScarStream(this.origin.source, { planner, camera, budgets: this.budgets, output: "words" });
    stream.on("front", (front) => {
      this.front = front;
      if (this.stage !== null) this.#setUp(this.stage, front);
      this.events.onFront();
    });
    stream.on("streaming", (streaming) => {
      const view = viewOfFile(streaming);
      if (view !== null) this.events.onView(view);
    });
    stream.on("tile", ({ output }) => this.#put(output as PackedTile));
    stream.on("evict", ({ tile }) => {
      this.#early.delete(tile);
      this.stage?.remove(tile);
      this.events.onChange();
    });
    stream.on("progress", () => this.events.onChange());
    stream.on("done", () => {
      this.done = true;
      this.events.onChange();
    });
    stream.on("error", (error) => {
      this.error = error;
      this.events.onError(error);
    });
    dispatch(STREAM_BEGINS, stream);
    return stream;
  }

  #setUp(stage: Stage, front: Front): void {
    const { sh_degree, render_model } = front.header;
    stage.open(placesFor(front, this.#stream.budgets), sh_degree, render_model);
    stage.showDegree(this.wish.degree);
  }

  #put(words: PackedTile): void {
    if (this.stage === null) this.#early.set(words.tile, words);
    else this.stage.put(words);
    this.events.onChange();
  }
}

function dispatch(name: string, detail: unknown): void {
  document.dispatchEvent(new CustomEvent(name, { detail }));
}

/** One scene on one stage: a stream, how much of it is wanted, and what has come. */

import { byView, readTold } from "../src/plan/by_view.js";
import type { Front } from "../src/stream/directory.js";
import type { StreamError } from "../src/stream/errors.js";
import { ScarStream, type Stats, type TileEvent } from "../src/stream/scar_stream.js";
import type { SourceLike } from "../src/stream/source.js";
import type { Budgets, Camera, Planner } from "../src/plan/types.js";
import type { PackedTile } from "../src/decoder/types.js";
import { placesFor } from "../src/pack/places.js";
import { type Frame, toldView } from "./framing.js";
import type { Stage } from "./stage.js";

export interface ShowingEvents {
  onFront(front: Front): void;
  /** The file names a view to begin with. */
  onView(view: Frame): void;
  /** Something is to be drawn or told. */
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

/** Events of the document, for who looks at the page from outside: a stream that begins, and a tile on the GPU. */
export const STREAM_BEGINS = "scar-stream";
export const TILE_DRAWN = "scar-drawn";

export class Showing {
  /** Null until what draws is there. */
  stage: Stage | null = null;
  front: Front | null = null;
  done = false;
  error: StreamError | null = null;
  #stream: ScarStream;
  #camera: Camera | null = null;
  /** What came before there was a stage, by tile. */
  readonly #early = new Map<number, TileEvent>();

  constructor(
    readonly name: string,
    readonly origin: SourceLike,
    readonly wish: Wish,
    private readonly events: ShowingEvents,
    private readonly budgets: Partial<Budgets>,
  ) {
    this.#stream = this.#open();
  }

  /** Draws on a stage from now on, and what has come already at once. */
  drawOn(stage: Stage): void {
    this.stage = stage;
    stage.onLost = () => this.restart();
    stage.onWritten = ({ tile, layer }) => tell(TILE_DRAWN, { tile, layer });
    if (this.front !== null) this.#setUp(stage, this.front);
    for (const event of this.#early.values()) this.#put(event);
    this.#early.clear();
  }

  /** Asks for more or fewer layers. Fewer begin anew: what is refined cannot be made coarse again. */
  wishLayers(layers: number): void {
    const fewer = layers < this.wish.layers;
    this.wish.layers = layers;
    if (fewer) this.restart();
    else if (this.#camera !== null) {
      this.done = false;
      this.#stream.setView(this.#camera);
    }
  }

  wishDegree(degree: number): void {
    this.wish.degree = degree;
    this.stage?.showDegree(degree);
    this.events.onChange();
  }

  setView(camera: Camera): void {
    this.#camera = camera;
    this.#stream.setView(camera);
  }

  /** Reads on after an error of the connection, or from the start where nothing was read. */
  again(): void {
    this.error = null;
    if (this.front === null || this.#fromFile()) this.restart();
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

  /** Whether what is wrong is of the file: then it may be another one by now. */
  #fromFile(): boolean {
    return this.error?.id === "file-changed";
  }

  #open(): ScarStream {
    this.done = false;
    this.error = null;
    const camera = this.#camera ?? undefined;
    const options = { output: "words", planner: this.#planner(), camera, budgets: this.budgets } as const;
    const stream = new ScarStream(this.origin, options);
    stream.on("front", (front) => {
      this.front = front;
      if (this.stage !== null) this.#setUp(this.stage, front);
      this.events.onFront(front);
    });
    stream.on("tile", (event) => this.#put(event));
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
    tell(STREAM_BEGINS, stream);
    return stream;
  }

  #setUp(stage: Stage, front: Front): void {
    stage.open(placesFor(front, this.#stream.budgets), front.header.sh_degree);
    stage.showDegree(this.wish.degree);
  }

  #put(event: TileEvent): void {
    if (this.stage === null) this.#early.set(event.tile, event);
    else this.stage.put(event.output as PackedTile);
    this.events.onChange();
  }

  /** Plans for the view, up to the layers wished for; on the way it sees what the file says of the first view. */
  #planner(): Planner {
    let told = false;
    return {
      annotation: byView.annotation,
      plan: (index, annotation, ...rest) => {
        const view = told || annotation === null ? null : toldView(readTold(annotation, index));
        told ||= annotation !== null;
        // The plan under way goes on with the camera that it was asked for; the next one has the view.
        if (view !== null) queueMicrotask(() => this.events.onView(view));
        return byView.plan(index, annotation, ...rest).filter(({ layer }) => layer <= this.wish.layers);
      },
    };
  }
}

function tell(name: string, detail: unknown): void {
  document.dispatchEvent(new CustomEvent(name, { detail }));
}

/** One scene on one stage: what it comes from, how much of it is wanted, and what has come. */

import { byView, readTold } from "../src/plan/by_view.js";
import type { StreamError } from "../src/stream/errors.js";
import type { Stats } from "../src/stream/scar_stream.js";
import type { Budgets, Camera, Planner } from "../src/plan/types.js";
import type { PackedTile } from "../src/decoder/types.js";
import { type Feed, isSeveral, openFeed, type Origin, type Outline, type Room } from "./feed.js";
import { type Frame, toldView } from "./framing.js";
import type { Stage } from "./stage.js";

export interface ShowingEvents {
  onFront(): void;
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
  front: Outline | null = null;
  done = false;
  error: StreamError | null = null;
  #feed: Feed;
  #camera: Camera | null = null;
  #rooms: Room[] = [];
  /** What came before there was a stage, by room, then key. */
  readonly #early = new Map<number, Map<number, PackedTile>>();

  constructor(
    readonly origin: Origin,
    readonly wish: Wish,
    private readonly events: ShowingEvents,
    private readonly budgets: Partial<Budgets>,
  ) {
    this.#feed = this.#open();
  }

  get name(): string {
    return this.origin.name;
  }

  /** Draws on a stage from now on, and what has come already at once. */
  drawOn(stage: Stage): void {
    this.stage = stage;
    stage.onLost = () => this.restart();
    stage.onWritten = ({ tile, layer }) => tell(TILE_DRAWN, { tile, layer });
    if (this.front !== null) this.#setUp(stage);
    for (const [room, tiles] of this.#early) for (const [key, words] of tiles) stage.put(room, key, words);
    this.#early.clear();
  }

  /** Asks for more or fewer layers. Fewer begin anew: what is refined cannot be made coarse again. */
  wishLayers(layers: number): void {
    const fewer = layers < this.wish.layers;
    this.wish.layers = layers;
    if (fewer) this.restart();
    else if (this.#camera !== null) {
      this.done = false;
      this.#feed.setView(this.#camera);
    }
  }

  wishDegree(degree: number): void {
    this.wish.degree = degree;
    this.stage?.showDegree(degree);
    this.events.onChange();
  }

  setView(camera: Camera): void {
    this.#camera = camera;
    this.#feed.setView(camera);
  }

  /** Reads on after an error of the connection, or from the start where nothing was read. */
  again(): void {
    this.error = null;
    if (this.front === null || this.#fromFile()) this.restart();
    else this.#feed.resume();
    this.events.onChange();
  }

  restart(): void {
    this.#feed.close();
    this.#early.clear();
    this.#feed = this.#open();
  }

  stats(): Stats {
    return this.#feed.stats();
  }

  close(): void {
    this.#feed.close();
    this.stage?.dispose();
  }

  /** Whether what is wrong is of the file: then it may be another one by now. */
  #fromFile(): boolean {
    return this.error?.id === "file-changed";
  }

  #open(): Feed {
    this.done = false;
    this.error = null;
    const camera = this.#camera ?? undefined;
    const feed = openFeed(this.origin, { planner: this.#planner(), camera, budgets: this.budgets }, {
      onFront: (outline, rooms) => {
        this.front = outline;
        this.#rooms = rooms;
        if (this.stage !== null) this.#setUp(this.stage);
        this.events.onFront();
      },
      onTile: (room, key, words) => this.#put(room, key, words),
      onEvict: (room, key) => {
        this.#early.get(room)?.delete(key);
        this.stage?.remove(room, key);
        this.events.onChange();
      },
      onProgress: () => this.events.onChange(),
      onDone: () => {
        this.done = true;
        this.events.onChange();
      },
      onError: (error) => {
        this.error = error;
        this.events.onError(error);
      },
    });
    tell(STREAM_BEGINS, feed);
    return feed;
  }

  #setUp(stage: Stage): void {
    stage.open(this.#rooms);
    stage.showDegree(this.wish.degree);
  }

  #put(room: number, key: number, words: PackedTile): void {
    if (this.stage === null) this.#early.set(room, (this.#early.get(room) ?? new Map()).set(key, words));
    else this.stage.put(room, key, words);
    this.events.onChange();
  }

  /** Plans for the view, up to the layers wished for; on the way it sees what one file says of the first view. */
  #planner(): Planner {
    let told = isSeveral(this.origin);
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

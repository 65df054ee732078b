/** One scene on one stage: a stream, how much of it is wanted, and what has come. */

import { byView, readTold } from "../src/plan/by_view.js";
import type { Front } from "../src/stream/front.js";
import type { StreamError } from "../src/stream/errors.js";
import { ScarStream, type Stats, type TileEvent } from "../src/stream/scar_stream.js";
import type { SourceLike } from "../src/stream/source.js";
import type { Camera, Planner } from "../src/plan/types.js";
import type { PackedTile } from "../src/decoder/types.js";
import { type Frame, toldView } from "./framing.js";
import { Stage } from "./stage.js";

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

export class Showing {
  readonly stage: Stage;
  front: Front | null = null;
  done = false;
  error: StreamError | null = null;
  #stream: ScarStream;
  #camera: Camera | null = null;

  constructor(
    readonly name: string,
    readonly origin: SourceLike,
    readonly wish: Wish,
    private readonly events: ShowingEvents,
  ) {
    this.stage = new Stage(() => this.restart());
    this.#stream = this.#open();
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
    this.stage.showDegree(degree);
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
    this.#stream = this.#open();
  }

  stats(): Stats {
    return this.#stream.stats();
  }

  close(): void {
    this.#stream.close();
    this.stage.dispose();
  }

  /** Whether what is wrong is of the file: then it may be another one by now. */
  #fromFile(): boolean {
    return this.error?.id === "file-changed";
  }

  #open(): ScarStream {
    this.done = false;
    this.error = null;
    const camera = this.#camera ?? undefined;
    const stream = new ScarStream(this.origin, { output: "words", planner: this.#planner(), camera });
    stream.on("front", (front) => {
      this.front = front;
      this.stage.open(front.total, front.header.sh_degree);
      this.stage.showDegree(this.wish.degree);
      this.events.onFront(front);
    });
    stream.on("tile", (event) => this.#put(event));
    stream.on("evict", ({ tile, base }) => {
      this.stage.remove(tile, base, this.front?.finalCounts[tile] ?? 0);
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
    return stream;
  }

  #put({ base, output }: TileEvent): void {
    this.stage.put(base, output as PackedTile);
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

/** A viewer in a page of one's own: `createViewer({ container, url })`. */

import type { Front } from "../format/directory.js";
import { Emitter } from "../stream/emitter.js";
import { StreamError } from "../stream/errors.js";
import { Feed, type FeedOptions } from "../stream/feed.js";
import type { Stats } from "../stream/scar_stream.js";
import type { SourceLike } from "../stream/source.js";
import { cameraOf, sideViews, type View } from "../plan/framing.js";
import { FrameRate } from "./frame_rate.js";
import { Pilot } from "./pilot.js";
import { Sketch } from "./sketch.js";
import type { Stage } from "./stage.js";

export type { FeedOptions, View };

export interface ViewerOptions {
  /** Filled by the picture; it needs a size of its own. */
  container: HTMLElement;
  /** What to show: an address, or a file of the user. `open` does the same later. */
  url?: SourceLike;
  /** Where to look from; what the file says unless given. */
  view?: View;
  /** Colour of CSS, or "transparent"; black unless given. */
  background?: string;
  /** Address of a picture that is shown until the scene is; the small one in the file unless given. */
  poster?: string;
  autoRotate?: boolean;
  /** Layers, budgets, headers and other options of the stream. */
  stream?: FeedOptions;
}

/**
 * "empty": nothing is to be shown; "loading": the file has not answered; "reading": something more comes; "drawing": all
 * has come, and the picture changes; "still"; "failed": nothing could be read.
 */
export type ViewerState = "empty" | "loading" | "reading" | "drawing" | "still" | "failed";

export interface ViewerStats extends Stats {
  /** Gaussians that the last frame drew. */
  splatsDrawn: number;
  /** Of the last second in which there were frames. */
  framesPerSecond: number;
}

export interface ViewerEvents {
  /** Header, layers and boxes of the file are known. */
  front: Front;
  state: ViewerState;
  /** Someone moved, or it turns by itself. Not what `view` was set to. */
  view: View;
  /** A tile is drawn after a layer. */
  drawn: { tile: number; layer: number };
  /** After each frame, and whenever something came. */
  frame: null;
  /** The connection failed, and is tried again. */
  retry: StreamError;
  /** Something failed. What is shown stays; where `fatal`, nothing more comes until `again`. */
  error: StreamError;
}

/** What is left of a sketch once the stage can draw, milliseconds. */
const SKETCH_MS = 15_000;

const LABEL = "3D scene. Drag or arrow keys: turn; right button or two fingers: move; wheel: nearer; W A S D Q E: fly.";

export class Viewer {
  readonly canvas = document.createElement("canvas");
  readonly #emitter = new Emitter<ViewerEvents>();
  readonly #resized = new ResizeObserver(() => this.#needFrame());
  #feed: Feed | null = null;
  readonly #pilot = new Pilot(this.canvas, () => this.#needFrame());
  /** Null until it has come. */
  #stage: Stage | null = null;
  #home: View | null = null;
  /** Whether someone chose where to look from, so that the file does not. */
  #chosen: boolean;
  /** Nothing can be drawn on this page. */
  #broken = false;
  #state: ViewerState = "empty";
  #background: string;
  /** Draws layer 1 until the stage does. */
  #sketch: Sketch | null = null;
  /** When the sketch goes although the stage does not have all that it shows. */
  #sketchEnds = Infinity;
  /** Whether the poster is gone. */
  #uncovered = false;
  /** Whether what draws is there, or under way. */
  #asked = false;
  /** Address of the small picture of the file, while it is shown. */
  #thumbnail: string | null = null;
  #frame = 0;
  readonly #frames = new FrameRate();
  #disposed = false;

  constructor(private readonly options: ViewerOptions) {
    const { container, url, background = "#000", autoRotate = false, poster } = options;
    this.#background = background;
    this.#pilot.autoRotate = autoRotate;
    this.#chosen = options.view !== undefined;
    Object.assign(this.canvas, { tabIndex: 0, role: "application", ariaLabel: LABEL });
    this.canvas.style.cssText = `display: block; width: 100%; height: 100%; touch-action: none; background: ${background}`;
    if (poster !== undefined) this.#hang(poster);
    container.append(this.canvas);
    this.#resized.observe(this.canvas);
    if (url === undefined) this.#fetchStage();
    else this.open(url);
  }

  /** @returns what takes the handler away again */
  on<Name extends keyof ViewerEvents>(name: Name, handler: (event: ViewerEvents[Name]) => void): () => void {
    return this.#emitter.on(name, handler);
  }

  /** Shows another scene in place of this one. */
  open(url: SourceLike): void {
    this.#feed?.close();
    this.#dropSketch();
    this.#home = null;
    const feed = new Feed(url, this.options.stream);
    this.#feed = feed;
    feed.on("front", (front) => {
      if (this.options.view !== undefined && this.#home === null) this.#goHome(this.options.view);
      this.#emitter.emit("front", front);
    });
    feed.on("opening", (view) => {
      if (!this.#chosen && !this.#pilot.moved) this.#goHome(view);
    });
    feed.on("thumbnail", (picture) => {
      if (this.options.poster !== undefined || this.#uncovered) return;
      this.#dropThumbnail();
      this.#thumbnail = URL.createObjectURL(new Blob([picture as BlobPart]));
      // As large as the view that it is a picture of will be: that has its field across the shorter side.
      this.#hang(this.#thumbnail, `auto ${Math.min(this.canvas.clientWidth, this.canvas.clientHeight)}px`);
    });
    feed.on("early", (words) => this.#makeSketch(feed)?.put(words));
    feed.on("change", () => this.#needFrame());
    feed.on("retry", (error) => this.#emitter.emit("retry", error));
    feed.on("error", (error) => {
      this.#emitter.emit("error", error);
      this.#needFrame();
    });
    this.#stage?.show(feed);
    this.#tellState(true);
    this.#needFrame();
  }

  get state(): ViewerState {
    return this.#state;
  }

  /** What the front of the file says, null before it is read. */
  get front(): Front | null {
    return this.#feed?.front ?? null;
  }

  /** Where the eye is; null before the file has said where to begin. */
  get view(): View | null {
    return this.#home === null ? null : this.#pilot.view;
  }

  set view(view: View) {
    this.#chosen = true;
    this.#home ??= view;
    this.#pilot.place(view);
  }

  /** Views to choose from, by name: "start", and from all sides once the front is read. */
  get views(): Record<string, View> {
    const start: Record<string, View> = this.#home === null ? {} : { start: this.#home };
    return this.front === null ? start : { ...start, ...sideViews(this.front) };
  }

  /** Layers that are asked for, from the first; Infinity for all. */
  get layers(): number {
    return this.#feed?.layers ?? Infinity;
  }

  set layers(layers: number) {
    if (this.#feed !== null) this.#feed.layers = layers;
  }

  /** A colour of CSS, or "transparent". */
  get background(): string {
    return this.#background;
  }

  set background(colour: string) {
    this.#background = colour;
    if (this.#uncovered) this.#paint();
    this.#needFrame();
  }

  /** Whether it turns by itself; ends when someone takes hold of the scene. */
  get autoRotate(): boolean {
    return this.#pilot.autoRotate;
  }

  set autoRotate(turns: boolean) {
    this.#pilot.autoRotate = turns;
  }

  stats(): ViewerStats | null {
    const drawn = { splatsDrawn: this.#stage?.splatsDrawn ?? 0, framesPerSecond: this.#frames.perSecond };
    return this.#feed === null ? null : { ...this.#feed.stats(), ...drawn };
  }

  /** The picture as it is now, of the size that it has on the page unless given. Rejects before there is one. */
  async screenshot({ width = this.canvas.width, height = this.canvas.height, type = "image/png" } = {}): Promise<Blob> {
    if (this.#stage === null) throw new Error("nothing is drawn yet");
    const picture = this.#stage.shoot(this.#pilot.view, width, height, type);
    this.#needFrame();
    return picture;
  }

  /** Shows the scene in a headset, from where the eye is. Rejects before something is drawn, and where there is none. */
  async enterXR(): Promise<void> {
    if (this.#stage === null) throw new Error("nothing is drawn yet");
    await this.#stage.enterXR(this.#pilot.view, () => this.#needFrame());
  }

  /** Tries again after an error. */
  again(): void {
    if (this.#feed?.error) this.#feed.again();
  }

  /** Ends everything: requests, workers, textures, handlers. The canvas leaves its container. */
  dispose(): void {
    this.#disposed = true;
    cancelAnimationFrame(this.#frame);
    this.#resized.disconnect();
    this.#emitter.clear();
    this.#feed?.close();
    this.#dropSketch();
    this.#stage?.dispose();
    this.#dropThumbnail();
    this.canvas.remove();
  }

  /** Three.js and Spark, which are larger than layer 1: they come after it. */
  #fetchStage(): void {
    if (this.#asked) return;
    this.#asked = true;
    import("./stage.js").then(
      (loaded) => this.#disposed || this.#begin(loaded),
      (cause: unknown) => this.#fail(cause),
    );
  }

  /** Null where a sketch cannot be drawn, so that what draws better has to say why. */
  #makeSketch({ front }: Feed): Sketch | null {
    if (this.#sketch === null && !this.#asked && front !== null) this.#sketch = Sketch.of(this.canvas, front);
    if (this.#sketch === null) this.#fetchStage();
    return this.#sketch;
  }

  #dropSketch(): void {
    this.#sketch?.dispose();
    this.#sketch = null;
    this.#stage?.reset();
  }

  /** Draws the sketch over what the stage has drawn, as long as that lacks something. */
  #drawSketch(lacks: boolean, now: number): void {
    const [sketch, view] = [this.#sketch, this.view];
    if (sketch === null || view === null) return;
    const shown = this.#stage?.splatsDrawn ?? 0;
    // What is behind the camera is of the sketch alone: while the camera turns, the stage may always lack something.
    const enough = !lacks || shown >= sketch.count || (now > this.#sketchEnds && shown > sketch.count / 2);
    if (shown > 0 && enough) return this.#dropSketch();
    for (const drawn of sketch.draw(view)) this.#emitter.emit("drawn", drawn);
    this.#stage?.reset();
  }

  #begin({ Stage }: typeof import("./stage.js")): void {
    try {
      this.#stage = new Stage(this.canvas, ({ tile, layer }) => this.#emitter.emit("drawn", { tile, layer }));
    } catch (cause) {
      return this.#fail(cause);
    }
    this.#sketchEnds = performance.now() + SKETCH_MS;
    if (this.#uncovered) this.#paint();
    if (this.#feed !== null) this.#stage.show(this.#feed);
    this.#needFrame();
  }

  #goHome(view: View): void {
    this.#home = view;
    this.#pilot.place(view);
    this.#look();
  }

  /** Tells what is looked at; where the stage draws, that does. */
  #look(): void {
    const [{ clientWidth, clientHeight }, view] = [this.canvas, this.view];
    if (this.#stage === null && view !== null && clientHeight > 0) this.#feed?.look(cameraOf(view, clientWidth, clientHeight));
  }

  /** What is behind the canvas is the page's, and no poster, once layer 1 covers it or someone looks from elsewhere. */
  #uncover(): void {
    const covered = this.#feed?.begun === true || this.#chosen || this.#pilot.moved;
    if (this.#uncovered || !covered) return;
    this.#uncovered = true;
    this.#paint();
    this.#dropThumbnail();
  }

  /** Puts the background behind the scene. */
  #paint(): void {
    this.canvas.style.background = this.#background;
    if (this.#stage !== null) this.#stage.background = this.#background;
  }

  /** Shows a picture behind what is drawn. @param size of CSS */
  #hang(address: string, size = "contain"): void {
    this.canvas.style.background = `center / ${size} no-repeat url(${JSON.stringify(address)}) ${this.#background}`;
  }

  #dropThumbnail(): void {
    if (this.#thumbnail !== null) URL.revokeObjectURL(this.#thumbnail);
    this.#thumbnail = null;
  }

  #fail(cause: unknown): void {
    const error = new StreamError("drawing", `this page cannot draw: ${cause instanceof Error ? cause.message : String(cause)}`, { cause });
    error.fatal = true;
    this.#broken = true;
    this.#emitter.emit("error", error);
    this.#needFrame();
  }

  #needFrame(): void {
    if (this.#frame === 0 && !this.#disposed) this.#frame = requestAnimationFrame((now) => this.#draw(now));
  }

  #draw(now: number): void {
    this.#frame = 0;
    if (this.#feed?.begun === true) this.#fetchStage();
    this.#uncover();
    const moves = this.#uncovered && this.#home !== null && this.#pilot.advance(now);
    if (moves) {
      this.#look();
      this.#emitter.emit("view", this.#pilot.view);
    }
    let lacks = this.#stage === null;
    if (this.canvas.clientHeight > 0) {
      lacks = this.#stage?.draw(this.#pilot.view) ?? true;
      this.#drawSketch(lacks, now);
      this.#frames.add(now);
    }
    this.#tellState(lacks || moves);
    this.#emitter.emit("frame", null);
    if (moves || (lacks && this.#stage !== null)) this.#needFrame();
  }

  #tellState(busy: boolean): void {
    const { front, done, error } = this.#feed ?? { front: null, done: false, error: null };
    const unread = this.#broken || (error !== null && front === null);
    const begun = done || error !== null;
    const shown: ViewerState = !begun ? "reading" : busy ? "drawing" : "still";
    const state = unread ? "failed" : this.#feed === null ? "empty" : front === null ? "loading" : shown;
    if (state === this.#state) return;
    this.#state = state;
    this.#emitter.emit("state", state);
  }
}

/** Shows a scene in a container of the page, and begins at once. */
export function createViewer(options: ViewerOptions): Viewer {
  return new Viewer(options);
}

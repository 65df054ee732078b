/** Runs in a page before its scripts: notes what streams deliver, when, and what keeps the main thread busy. */

/** Milliseconds since the page began. */
export interface PageLog {
  /** When the scene was asked for. */
  click: number;
  fronts: number[];
  /** [when, tile, layer]: decoded, and on the GPU. */
  tiles: [number, number, number][];
  drawn: [number, number, number][];
  evicted: [number, number][];
  /** [when, bytes of the file that have come]. */
  bytes: [number, number][];
  /** [start, milliseconds]: tasks over 50 ms. */
  long: [number, number][];
  /** [start, milliseconds, name]: calls of WebGL that took more than a millisecond. */
  waits: [number, number, string][];
  mostMemory: number;
  frames: number;
  done: number | null;
  stats: Record<string, unknown> | null;
  errors: string[];
}

interface Stream {
  on(name: string, handler: (event: never) => void): void;
  stats(): { memory: number; bytesRead: number };
}

/** @param draws whether WebGL draws: in software that takes the time that it is to be measured without */
export function watchPage(draws: boolean): void {
  const log: PageLog = {
    ...{ click: 0, fronts: [], tiles: [], drawn: [], evicted: [], bytes: [], long: [], waits: [], errors: [] },
    ...{ mostMemory: 0, frames: 0, done: null, stats: null },
  };
  Object.assign(window, { pageLog: log });
  const now = () => performance.now();
  document.addEventListener("scar-stream", (event) => {
    const stream = (event as CustomEvent<Stream>).detail;
    const look = () => {
      const { memory, bytesRead } = stream.stats();
      log.mostMemory = Math.max(log.mostMemory, memory);
      log.bytes.push([now(), bytesRead]);
    };
    stream.on("front", () => log.fronts.push(now()));
    stream.on("tile", ({ tile, layer }: { tile: number; layer: number }) => {
      log.tiles.push([now(), tile, layer]);
      look();
    });
    stream.on("evict", ({ tile }: { tile: number }) => log.evicted.push([now(), tile]));
    stream.on("progress", look);
    stream.on("error", ({ message }: { message: string }) => log.errors.push(message));
    stream.on("done", () => {
      log.done = now();
      log.stats = stream.stats();
    });
  });
  document.addEventListener("scar-drawn", (event) => {
    const { tile, layer } = (event as CustomEvent<{ tile: number; layer: number }>).detail;
    log.drawn.push([now(), tile, layer]);
  });
  new PerformanceObserver((list) => {
    for (const { startTime, duration } of list.getEntries()) log.long.push([startTime, duration]);
  }).observe({ type: "longtask", buffered: true });
  const each = () => {
    log.frames++;
    requestAnimationFrame(each);
  };
  requestAnimationFrame(each);

  const context = WebGL2RenderingContext.prototype as unknown as Record<string, unknown>;
  for (const name of Object.getOwnPropertyNames(context)) {
    const found = Object.getOwnPropertyDescriptor(context, name)?.value as unknown;
    if (typeof found !== "function" || name === "constructor") continue;
    const call = found as (...given: unknown[]) => unknown;
    const isDraw = /^draw(Arrays|Elements|RangeElements)/.test(name);
    context[name] = function (...given: unknown[]) {
      if (isDraw && !draws) return undefined;
      const started = now();
      const result = call.apply(this, given);
      const took = now() - started;
      if (took > 1) log.waits.push([started, took, name]);
      return result;
    };
  }
}

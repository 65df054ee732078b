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
  /** When the mark of the trace was made. */
  marked: number;
  mostMemory: number;
  /** Tiles that are decoded further than they are on the GPU. */
  waiting: number;
  frames: number;
  done: number | null;
  stats: Record<string, unknown> | null;
  errors: string[];
}

interface Stream {
  on(name: string, handler: (event: never) => void): void;
  stats(): { memory: number; bytesRead: number };
}

/** In traces, so that their times can be told in the page's. */
export const MARK = "page-log";

/**
 * @param draws whether WebGL draws: in software that takes the time that it is to be measured without
 * @param mark name of a mark in the trace
 */
export function watchPage(draws: boolean, mark: string): void {
  const log: PageLog = {
    ...{ click: 0, marked: 0, fronts: [], tiles: [], drawn: [], evicted: [], bytes: [], errors: [] },
    ...{ mostMemory: 0, waiting: 0, frames: 0, done: null, stats: null },
  };
  Object.assign(window, { pageLog: log });
  const now = () => performance.now();
  const behind = new Map<number, number>();
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
      log.waiting = behind.set(tile, layer).size;
      look();
    });
    stream.on("evict", ({ tile }: { tile: number }) => {
      log.evicted.push([now(), tile]);
      behind.delete(tile);
      log.waiting = behind.size;
    });
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
    if (behind.get(tile) === layer) behind.delete(tile);
    log.waiting = behind.size;
  });
  log.marked = performance.mark(mark).startTime;
  const each = () => {
    log.frames++;
    requestAnimationFrame(each);
  };
  requestAnimationFrame(each);

  if (draws) return;
  const context = WebGL2RenderingContext.prototype as unknown as Record<string, unknown>;
  for (const name of Object.getOwnPropertyNames(context)) {
    if (/^(draw(Arrays|Elements|RangeElements)|clear$)/.test(name)) context[name] = () => undefined;
  }
  // Nor is what is not there put together with the rest of the page, which is done in software, too.
  document.addEventListener("DOMContentLoaded", () => {
    document.head.append(Object.assign(document.createElement("style"), { textContent: "body { visibility: hidden }" }));
  });
}

/**
 * When the page shows a scene over a slow connection, and what it takes:
 * `node dist/tests/times.mjs URL KBIT_S LATENCY_MS [SLOWER [HEAP_MB]]`. URL is what `scarfmt view` prints; Chromium shapes
 * the connection, makes the processor so many times slower, and gives scripts no more heap. With SLOWER the
 * page is as large as on a phone that says it has 2 GB, and all layers are waited for.
 *
 * Prints JSON: when the small picture, the first tile and all of layer 1 were drawn, and all layers, milliseconds from the
 * request for the page, three seconds after the browser's start; the longest tasks of the page; the largest heap of its
 * scripts, what the stream counts, and textures, MB; and what was loaded, in order, with its bytes.
 */

import { browsingWith } from "./chromium.js";

/** What has not come by then is not in the answer. */
const PATIENCE_MS = 180_000;

/** In the page: notes when something is first seen. */
function watchPage(): void {
  const seen: Record<string, number> = {};
  Object.assign(window, { seen });
  const look = () => {
    const canvas = document.querySelector("canvas");
    if (canvas?.style.background.includes("blob:")) seen.poster ??= performance.now();
    requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
  document.addEventListener("scar-viewer", ({ detail: viewer }: CustomEventInit) => {
    const drawn = new Map<number, number>();
    viewer.on("front", () => (seen.front ??= performance.now()));
    viewer.on("drawn", ({ tile, layer }: { tile: number; layer: number }) => {
      const { tiles, layers } = viewer.front.index;
      seen.tile ??= performance.now();
      drawn.set(tile, layer);
      if (drawn.size < tiles) return;
      seen.layer ??= performance.now();
      if ([...drawn.values()].every((layer) => layer === layers)) seen.all ??= performance.now();
    });
    viewer.on("state", (state: string) => (seen[state] = performance.now()));
  });
}

/** In the page: what was loaded, in order. */
const LOADED = `performance.getEntriesByType("resource").map(({ name, startTime, responseEnd, transferSize }) => {
  return [name.split("/").pop(), Math.round(startTime), Math.round(responseEnd), transferSize];
})`;

/** In the page: notes long tasks, the stream's memory, and the sizes of textures. */
function watchCosts(): void {
  const costs = { tasks: [] as number[], stream: 0, textures: 0 };
  Object.assign(window, { costs });
  new PerformanceObserver((list) => costs.tasks.push(...list.getEntries().map(({ duration }) => duration))).observe({ type: "longtask" });
  document.addEventListener("scar-viewer", ({ detail: viewer }: CustomEventInit) => {
    viewer.on("frame", () => (costs.stream = Math.max(costs.stream, viewer.stats()?.memory ?? 0)));
  });
  for (const name of ["texStorage2D", "texStorage3D"] as const) {
    const made = WebGL2RenderingContext.prototype[name] as (...given: number[]) => void;
    WebGL2RenderingContext.prototype[name] = function (target: number, levels: number, format: number, ...sizes: number[]) {
      costs.textures += sizes.reduce((a, b) => a * b, format === this.RGBA32UI ? 16 : 4);
      made.call(this, target, levels, format, ...sizes);
    };
  }
}

const [url, kbits, latency, slower, heap] = process.argv.slice(2);
await browsingWith(heap === undefined ? [] : [`--js-flags=--max-old-space-size=${heap}`])(
  async (page) => {
    await page.evaluateOnNewDocument(watchPage);
    await page.evaluateOnNewDocument(watchCosts);
    await page.emulateNetworkConditions({ download: (Number(kbits) * 1000) / 8, upload: 1e6, latency: Number(latency) });
    if (slower !== undefined) {
      await page.evaluateOnNewDocument("Object.defineProperty(navigator, 'deviceMemory', { value: 2 })");
      await page.emulateCPUThrottling(Number(slower));
    }
    await new Promise((resolve) => setTimeout(resolve, 3000));
    await page.goto(url, { waitUntil: "domcontentloaded" });
    const end = slower === undefined ? "seen.layer" : "seen.all";
    let most = 0;
    const giveUp = Date.now() + PATIENCE_MS;
    for (let ended = false; !ended && Date.now() < giveUp; await new Promise((resolve) => setTimeout(resolve, 200))) {
      ended = (await page.evaluate(`${end} !== undefined`)) as boolean;
      most = Math.max(most, (await page.metrics()).JSHeapUsedSize ?? 0);
    }
    const { tasks, stream, textures } = (await page.evaluate("costs")) as { tasks: number[]; stream: number; textures: number };
    const megabytes = (bytes: number) => Math.round(bytes / 1e6);
    const costs = { tasks: tasks.sort((a, b) => b - a).slice(0, 5), heap: megabytes(most), stream: megabytes(stream), textures: megabytes(textures) };
    console.log(JSON.stringify({ seen: await page.evaluate("seen"), ...costs, loaded: await page.evaluate(LOADED) }));
  },
  slower === undefined ? { width: 1280, height: 800 } : { width: 390, height: 844 },
);

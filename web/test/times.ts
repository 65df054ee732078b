/**
 * When the page shows a scene over a slow connection: `node dist/tests/times.mjs URL KBIT_S LATENCY_MS`. URL is what
 * `scarfmt view` prints; Chromium shapes the connection. Prints JSON: when the small picture, the first tile and all of
 * layer 1 were drawn, milliseconds from the request for the page, and what was loaded, in order, with its bytes.
 */

import { browsing } from "./chromium.js";

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
    const drawn = new Set<number>();
    viewer.on("front", () => (seen.front ??= performance.now()));
    viewer.on("drawn", ({ tile }: { tile: number }) => {
      seen.tile ??= performance.now();
      drawn.add(tile);
      if (drawn.size === viewer.front.index.tiles) seen.layer ??= performance.now();
    });
    viewer.on("state", (state: string) => (seen[state] = performance.now()));
  });
}

/** In the page: what was loaded, in order. */
const LOADED = `performance.getEntriesByType("resource").map(({ name, startTime, responseEnd, transferSize }) => {
  return [name.split("/").pop(), Math.round(startTime), Math.round(responseEnd), transferSize];
})`;

const [url, kbits, latency] = process.argv.slice(2);
await browsing(
  async (page) => {
    await page.evaluateOnNewDocument(watchPage);
    await page.emulateNetworkConditions({ download: (Number(kbits) * 1000) / 8, upload: 1e6, latency: Number(latency) });
    await page.goto(url, { waitUntil: "domcontentloaded" });
    await page.waitForFunction("seen.layer !== undefined", { polling: 200 });
    console.log(JSON.stringify({ seen: await page.evaluate("seen"), loaded: await page.evaluate(LOADED) }));
  },
  { width: 1280, height: 800 },
);

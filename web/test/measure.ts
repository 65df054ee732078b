/**
 * What a page does with a scene that comes over a slow network: `node measure.mjs '{"page": "http://…/", …}'` prints the
 * `PageLog` as JSON. benchmarks/streaming_browser.py reads it.
 */

import { browsing } from "./chromium.js";
import { ShapedNetwork } from "./shaped.js";
import { type PageLog, watchPage } from "./watched_page.js";

interface Wish {
  /** Port of the server, path of the scene. */
  port: number;
  scene: string;
  /** Added to the page's address: a view, a budget. */
  query: string;
  mbitPerSecond: number;
  roundTripMs: number;
  width: number;
  height: number;
  /** Whether the page is open already, and the scene is dropped on it; else the page comes over the same network. */
  open: boolean;
  /** Whether WebGL draws. */
  draws: boolean;
  /** Press of a key after the scene is there, and how long to look on. */
  key?: string;
  patienceMs: number;
}

const AFTERWARDS_MS = 500;
const wish = JSON.parse(process.argv[2]) as Wish;
const { width, height } = wish;
const network = new ShapedNetwork(wish.port, Infinity, 0);
const address = `http://127.0.0.1:${await network.start()}/`;

function slowDown(): void {
  network.rate = wish.mbitPerSecond * 125_000;
  network.roundTripMs = wish.roundTripMs;
}

await browsing(
  async (page) => {
    await page.evaluateOnNewDocument(watchPage, wish.draws);
    if (wish.open) {
      await page.goto(`${address}?${wish.query}`, { waitUntil: "networkidle0" });
      slowDown();
      const before = network.delivered;
      await page.evaluate((scene) => {
        const dropped = new DataTransfer();
        dropped.setData("text/uri-list", new URL(scene, location.href).href);
        const { pageLog } = window as unknown as { pageLog: PageLog };
        pageLog.long.length = pageLog.waits.length = 0;
        pageLog.click = performance.now();
        document.dispatchEvent(new DragEvent("drop", { dataTransfer: dropped, cancelable: true }));
      }, wish.scene);
      network.delivered -= before;
    } else {
      slowDown();
      const query = new URLSearchParams(wish.query);
      query.set("url", wish.scene);
      await page.goto(`${address}?${query}`, { waitUntil: "domcontentloaded" });
    }
    const isDone = "pageLog.done !== null || pageLog.errors.length > 0";
    await page.waitForFunction(isDone, { timeout: wish.patienceMs, polling: 50 });
    await new Promise((resolve) => setTimeout(resolve, AFTERWARDS_MS));
    if (wish.key !== undefined) {
      await page.evaluate("pageLog.long.length = pageLog.waits.length = 0");
      await page.keyboard.press(wish.key as "c");
      await new Promise((resolve) => setTimeout(resolve, 4 * AFTERWARDS_MS));
    }
    const log = await page.evaluate("pageLog");
    process.stdout.write(`${JSON.stringify({ ...(log as PageLog), delivered: network.delivered })}\n`);
  },
  { width, height },
);
network.stop();

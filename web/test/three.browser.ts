/** The example page for three.js in a real browser: a loaded scene draws where it is put, for the camera that there is, and ends. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { lit } from "./chromium.js";
import { toys } from "./files.js";
import { serving } from "./server.js";
import { sharedBrowser } from "./shared_browser.js";

const browsing = sharedBrowser();

describe("a scene in three.js", () => {
  it("draws, is asked for as its camera sees it, and leaves nothing behind", { timeout: 120_000 }, async () => {
    await serving(
      toys(),
      (url) =>
        browsing(async (page) => {
          await page.goto(`${new URL("/", url)}examples/three.html?url=/scene.scar`);
          await page.waitForFunction("globalThis.toys?.feed.done && !toys.busy", { polling: 100 });
          assert.ok((await lit(page)) > 0.1);
          await page.evaluate("toys.feed.look = (view) => (globalThis.told = view); camera.position.x += 0.1; 0");
          await page.waitForFunction("globalThis.told !== undefined", { polling: 100 });
          const [eye, told] = (await page.evaluate("[toys.worldToLocal(camera.position.clone()).toArray(), told.position]")) as number[][];
          eye.forEach((x, axis) => assert.ok(Math.abs(x - told[axis]) < 1e-6));
          await page.evaluate("toys.dispose()");
          await page.waitForFunction("scene.children.every(({ type }) => type !== 'Group')");
          const workers = () => page.workers().some((worker) => worker.url().endsWith("/worker.js"));
          while (workers()) await page.evaluate("new Promise((end) => setTimeout(end, 100))");
        }, { width: 240, height: 180 }),
      new URL("../../", import.meta.url),
    );
  });
});

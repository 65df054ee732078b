/** The example page for PlayCanvas in a real browser: a scene as an asset draws, refines, hides what is evicted, and ends. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import type { Page } from "puppeteer-core";
import { lit } from "./chromium.js";
import { ask, exampleOf, look, settle, untilLayers, untilTrue } from "./example.js";
import { toys } from "./files.js";
import type { FileServer } from "./server.js";
import { sharedBrowser } from "./shared_browser.js";

const bytes = toys();
const browsing = sharedBrowser();
const LAYERS = 5;
/** Onto the toys: position, target, up, degrees. */
const VIEW = [1.9, 1.41, -3.46, 0.76, 0.67, 0.3, 0.18, -0.97, -0.14, 17];
/** How far numbers may be apart that PlayCanvas has turned there and back in float32. */
const CLOSE = 1e-4;

/** Runs with the example open on a scene whose server can be told to misbehave. */
async function opened(run: (page: Page, server: FileServer) => Promise<void>, prepare?: (server: FileServer) => void) {
  const inPage = async (page: Page, server: FileServer) => {
    await untilTrue(page, "resource");
    await run(page, server);
  };
  await exampleOf(bytes, inPage, { open: browsing, prepare });
}

/** Waits until the share of the picture that is lit is as it should be: sorting is another worker's, whenever that runs. */
async function untilLit(page: Page, isRight: (share: number) => boolean): Promise<void> {
  let share = await lit(page);
  for (let tries = 0; tries < 60 && !isRight(share); tries++) {
    await settle(page);
    share = await lit(page);
  }
  assert.ok(isRight(share), `${share} of the picture is lit`);
}

describe("a scene in PlayCanvas", () => {
  it("draws the first layer before the others have come, and gets finer in place", async () => {
    let release: () => void = () => undefined;
    await opened(
      async (page) => {
        await look(page, VIEW);
        await untilLayers(page, 1);
        await untilLit(page, (share) => share > 0.3);
        const first = await page.screenshot({ encoding: "base64" });
        assert.ok((await ask<number>(page, "stream.stats().layerAt.filter((at) => at !== null).length")) < LAYERS);
        release();
        await untilLayers(page, LAYERS);
        assert.notEqual(await page.screenshot({ encoding: "base64" }), first);
      },
      (server) => {
        release = server.holdAfter(60_000);
      },
    );
  });

  it("tells the stream where the camera is among the Gaussians, when it has moved", async () => {
    await opened(async (page) => {
      await look(page, VIEW);
      await settle(page);
      await ask(page, "(globalThis.views = []) && (stream.setView = (view) => views.push(view))");
      await settle(page);
      assert.equal(await ask(page, "views.length"), 0);
      const moved = [...VIEW.slice(0, 2), VIEW[2] - 1, ...VIEW.slice(3)];
      await look(page, moved);
      await untilTrue(page, "views.length > 0");
      const view = await ask<{ position: number[]; forward: number[]; up: number[]; fovY: number; width: number }>(page, "views[0]");
      const along = [0, 1, 2].map((axis) => moved[3 + axis] - moved[axis]);
      const forward = along.map((x) => x / Math.hypot(...along));
      view.position.forEach((x, axis) => assert.ok(Math.abs(x - moved[axis]) < CLOSE));
      view.forward.forEach((x, axis) => assert.ok(Math.abs(x - forward[axis]) < CLOSE));
      assert.ok(view.up[1] < -0.9);
      assert.ok(Math.abs(view.fovY - (17 * Math.PI) / 180) < CLOSE);
      assert.equal(view.width, 480);
    });
  });

  it("hides what a budget evicts", async () => {
    await opened(async (page) => {
      await look(page, VIEW);
      await untilLayers(page, LAYERS);
      await settle(page);
      const before = await lit(page);
      await ask(page, "stream.setBudget({ splats: 500 })");
      await untilTrue(page, "stream.stats().splatsShown <= 500 && !resource.waiting");
      await settle(page);
      await untilLit(page, (share) => share < before - 0.1);
    });
  });

  it("is there again after the device was lost", async () => {
    await opened(async (page) => {
      await look(page, VIEW);
      await untilLayers(page, LAYERS);
      await settle(page);
      const before = await lit(page);
      await ask(page, "(globalThis.loss = app.graphicsDevice.gl.getExtension('WEBGL_lose_context')).loseContext()");
      await untilTrue(page, "app.graphicsDevice.contextLost");
      await ask(page, "loss.restoreContext()");
      await untilTrue(page, "!app.graphicsDevice.contextLost");
      await untilLit(page, (share) => Math.abs(share - before) < 0.01);
    });
  });

  it("ends with its asset: no request, no worker, no texture stays", async () => {
    await opened(
      async (page, server) => {
        const ours = () => page.workers().filter((worker) => worker.url().endsWith("/worker.js")).length;
        const textures = "[...app.graphicsDevice.textures].filter(({ name }) => name.startsWith('scar')).length";
        await untilTrue(page, "stream.stats().tilesShown > 0");
        assert.ok(ours() > 0);
        assert.equal(await ask(page, textures), 5);
        await ask(page, "asset.unload()");
        await untilTrue(page, `${textures} === 0`);
        for (let waits = 0; waits < 50 && (ours() > 0 || server.pending > 0); waits++) await settle(page);
        assert.equal(ours(), 0);
        assert.equal(server.pending, 0);
      },
      (server) => {
        server.ranges = false;
        server.trick = (_, response) => {
          response.writeHead(200, { "Content-Length": String(bytes.length) });
          response.write(bytes.subarray(0, 60_000));
          return true;
        };
      },
    );
  });

  it("says what cannot be loaded, and what is damaged while the rest is shown", async () => {
    await opened(
      async (page) => {
        await ask(page, "asset.on('error', ({ id }) => (globalThis.damage = id))");
        await untilTrue(page, "globalThis.damage === 'crc-mismatch'");
        await untilLayers(page, LAYERS - 1);
        await untilLit(page, (share) => share > 0.1);
        await ask(
          page,
          `(() => {
            const other = new pc.Asset("other", "gsplat", { url: "/README.md?.scar", filename: "none.scar" });
            other.on("error", (error) => (globalThis.refusal = String(error)));
            app.assets.add(other);
            app.assets.load(other);
          })()`,
        );
        await untilTrue(page, "globalThis.refusal");
        assert.match(await ask<string>(page, "refusal"), /not a .scar|signature/);
      },
      (server) => {
        // So that someone listens before the damage is found.
        server.delay = 500;
        server.bytes = server.bytes.slice();
        server.bytes[bytes.length - 3000] ^= 0xff;
      },
    );
  });
});

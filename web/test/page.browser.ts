/** The viewer page in a real browser: it draws, refines, obeys its keys and its address. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import type { Page } from "puppeteer-core";
import { bare, lit, psnr, until } from "./chromium.js";
import type { Viewer } from "../src/viewer/viewer.js";
import { vector } from "./files.js";
import { sharedBrowser } from "./shared_browser.js";
import { bytes, untilComplete, viewingIn } from "./viewing.js";

const viewing = viewingIn(sharedBrowser());

/** Between a sketch and Spark, dB. */
const LEAST_PSNR = 35;

/** `viewer` in the page is its first. */
const withViewer = {
  before: () => {
    document.addEventListener("scar-viewer", (event) => Object.assign(window, { viewer: (event as CustomEvent).detail }));
  },
};

/** Drags over the scene, and waits until it is at rest again. */
async function dragged(page: Page): Promise<void> {
  await page.mouse.move(240, 180);
  await page.mouse.down();
  await page.mouse.move(300, 160);
  await page.mouse.up();
  const still = "new Promise((resolve) => setTimeout((seen = viewer.view) => resolve(seen === viewer.view), 1000, viewer.view))";
  await page.waitForFunction(still, { polling: 100 });
}

describe("the viewer page", () => {
  it("draws a scene, all layers of it, and asks no one else for anything", async () => {
    await viewing(async (page, server) => {
      await untilComplete(page, 5);
      assert.ok((await lit(page)) > 0.3);
      const read = server.asked.reduce((sum, { range }) => sum + (range === null ? 0 : Math.min(range[1], bytes.length - 1) - range[0] + 1), 0);
      assert.ok(read < 1.1 * bytes.length + 65_536, `${read} bytes were read of ${bytes.length}`);
    });
  });

  it("takes fewer layers, compares two, and goes back", async () => {
    await viewing(async (page) => {
      await until(page, "still");
      await page.keyboard.press("1");
      await untilComplete(page, 1);
      await page.keyboard.press("c");
      await page.waitForFunction("document.querySelectorAll('canvas').length === 2", { polling: 100 });
      await page.keyboard.press("c");
      await page.waitForFunction("document.querySelectorAll('canvas').length === 1", { polling: 100 });
      await untilComplete(page, 5);
    });
  });

  it("goes to views, turns by itself until someone takes hold of it, and comes back", async () => {
    await viewing(async (page) => {
      await until(page, "still");
      const eye = () => page.evaluate("viewer.view.position.join()");
      const home = await eye();
      await page.keyboard.press("v");
      assert.notEqual(await eye(), home);
      await page.keyboard.press("t");
      await page.waitForFunction("viewer.autoRotate && viewer.state === 'drawing'", { polling: 100 });
      await page.mouse.click(240, 180);
      await until(page, "still");
      await page.keyboard.press("r");
      assert.equal(await eye(), home);
    }, withViewer);
  });

  it("has help, another background, a picture to save, and nothing but the scene where that is wished", async () => {
    await viewing(
      async (page) => {
        await until(page, "still");
        await page.keyboard.press("?");
        assert.equal(await page.$eval("#keys", (keys) => (keys as HTMLDialogElement).open), true);
        await page.keyboard.press("Escape");
        assert.equal(await page.$eval("#keys", (keys) => (keys as HTMLDialogElement).open), false);
        assert.equal(await page.$eval("#tools", (tools) => getComputedStyle(tools).display), "none");
        await page.keyboard.press("b");
        await page.keyboard.press("b");
        const [type, corner] = (await page.evaluate(`(async () => {
          const blob = await viewer.screenshot({ width: 64, height: 48 });
          const picture = await createImageBitmap(blob);
          const context = new OffscreenCanvas(64, 48).getContext("2d");
          context.drawImage(picture, 0, 0);
          return [blob.type + picture.width, [...context.getImageData(0, 0, 1, 1).data].join()];
        })()`)) as [string, string];
        assert.equal(type, "image/png64");
        assert.equal(corner, "255,255,255,255");
      },
      { query: "url=/scene.scar&noui", ...withViewer },
    );
  });

  it("shows a link that is dropped on it", async () => {
    await viewing(
      async (page) => {
        await page.evaluate(() => {
          const dropped = new DataTransfer();
          dropped.setData("text/uri-list", `# a remark\r\n${location.origin}/scene.scar`);
          document.dispatchEvent(new DragEvent("drop", { dataTransfer: dropped, cancelable: true }));
        });
        await untilComplete(page, 5);
      },
      { query: "" },
    );
  });
});

describe("a page that loads", () => {
  it("asks for the scene before its scripts have come, once", async () => {
    let asked: () => void;
    const scene = new Promise<void>((resolve) => (asked = resolve));
    await viewing(
      async (page, server) => {
        await untilComplete(page, 5);
        assert.equal(server.asked.filter(({ range }) => range?.[0] === 0).length, 1);
      },
      {
        prepare: (server) => {
          server.before = async (name) => (name.endsWith(".js") ? scene : undefined);
          server.trick = () => {
            asked();
            return false;
          };
        },
      },
    );
  });

  it("shows the small picture in the file until layer 1 has come", async () => {
    let release: () => void = () => undefined;
    const held = new Promise<void>((resolve) => (release = resolve));
    const poster = 'document.querySelector("canvas")?.style.background.includes("blob:")';
    await viewing(
      async (page) => {
        await page.waitForFunction(poster, { polling: 50 });
        release();
        await page.waitForFunction(`!${poster}`, { polling: 50 });
      },
      {
        scene: vector("valid/annotations"),
        prepare: (server) => {
          server.before = async (name) => (name === "scar.wasm" ? held : undefined);
        },
      },
    );
  });

  it("draws layer 1 for who looks round before the library that draws has come, and nearly as that does", async () => {
    let release: () => void = () => undefined;
    const held = new Promise<void>((resolve) => (release = resolve));
    await viewing(
      async (page) => {
        await page.waitForFunction("viewer.stats()?.layerAt[0] && getComputedStyle(viewer.canvas).backgroundImage === 'none'", { polling: 100 });
        await page.evaluate("new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve)))");
        assert.deepEqual((await page.evaluate("viewer.stats().tilesAtLayer")) as number[], [24, 0, 0, 0, 0]);
        await bare(page);
        const seen = await page.evaluate("viewer.view.position.join()");
        await dragged(page);
        assert.notEqual(await page.evaluate("viewer.view.position.join()"), seen);
        const sketched = await page.screenshot({ encoding: "base64" });
        release();
        await until(page, "still");
        await page.keyboard.press("1");
        await untilComplete(page, 1);
        const alike = await psnr(page, sketched, await page.screenshot({ encoding: "base64" }));
        assert.ok(alike > LEAST_PSNR, `${alike} dB`);
      },
      {
        ...withViewer,
        prepare: (server) => {
          server.before = async (name) => (name.startsWith("stage-") ? held : undefined);
        },
      },
    );
  });

  it("fetches and compiles the decoder once for all workers and scenes", async () => {
    await viewing(async (page, { named }) => {
      await untilComplete(page, 5);
      await page.keyboard.press("c");
      await page.waitForFunction("document.querySelectorAll('canvas').length === 2", { polling: 100 });
      await until(page, "still");
      assert.equal(named.filter((name) => name === "scar.wasm").length, 1);
    });
  });
});

describe("what a page takes", () => {
  /** Notes the most memory that viewers have said they use. */
  const watchMemory = () => {
    const seen = { most: 0 };
    Object.assign(window, { seen });
    document.addEventListener("scar-viewer", (event) => {
      const viewer = (event as CustomEvent<Viewer>).detail;
      viewer.on("frame", () => (seen.most = Math.max(seen.most, viewer.stats()?.memory ?? 0)));
    });
  };

  it("keeps within the memory that its address says, and draws", async () => {
    const megabytes = 7;
    await viewing(
      async (page) => {
        await until(page, "still");
        await page.keyboard.press("v");
        await page.keyboard.press("v");
        await until(page, "still");
        const { most } = (await page.evaluate("seen")) as { most: number };
        // What WebAssembly takes for tables of a layer when it first needs them is learnt when it has them.
        assert.ok(most <= 1.05e6 * megabytes, `${most} bytes`);
        assert.ok((await lit(page)) > 0.02);
      },
      { query: `url=/scene.scar&memory=${megabytes}`, before: watchMemory },
    );
  });
});

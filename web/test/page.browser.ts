/** The viewer page in a real browser: it draws, refines, obeys its keys and its address. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { lit, until } from "./chromium.js";
import type { ScarStream } from "../src/stream/scar_stream.js";
import { sharedBrowser } from "./shared_browser.js";
import { bytes, complete, untilComplete, viewingIn } from "./viewing.js";

const viewing = viewingIn(sharedBrowser());

describe("the viewer page", () => {
  it("draws a scene, all layers of it, and asks no one else for anything", async () => {
    await viewing(async (page, server) => {
      await untilComplete(page, 5);
      assert.ok((await lit(page)) > 0.3);
      const read = server.asked.reduce((sum, { range }) => sum + (range === null ? 0 : Math.min(range[1], bytes.length - 1) - range[0] + 1), 0);
      assert.ok(read < 1.1 * bytes.length + 65_536, `${read} bytes were read of ${bytes.length}`);
    });
  });

  it("shows the first layer before the others have come", async () => {
    let release: () => void = () => undefined;
    await viewing(
      async (page) => {
        await page.waitForFunction("document.querySelectorAll('tr.complete').length >= 1", { polling: 100 });
        assert.ok((await complete(page)) < 5);
        release();
        await untilComplete(page, 5);
      },
      {
        prepare: (server) => {
          release = server.holdAfter(60_000);
        },
      },
    );
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
  it("asks for the scene before the largest script has come", async () => {
    let asked: () => void;
    const scene = new Promise<void>((resolve) => (asked = resolve));
    await viewing(async (page) => untilComplete(page, 5), {
      prepare: (server, host) => {
        host.before = async (name) => (name.startsWith("drawing-") ? scene : undefined);
        server.trick = () => {
          asked();
          return false;
        };
      },
    });
  });

  it("fetches and compiles the decoder once for all workers and scenes", async () => {
    await viewing(async (page, _, { asked }) => {
      await untilComplete(page, 5);
      await page.keyboard.press("c");
      await page.waitForFunction("document.querySelectorAll('canvas').length === 2", { polling: 100 });
      await until(page, "still");
      assert.equal(asked.filter((name) => name === "scar.wasm").length, 1);
    });
  });
});

describe("what a page takes", () => {
  /** Notes the most memory that streams have said they use. */
  const watchMemory = () => {
    const seen = { most: 0, evicted: 0 };
    Object.assign(window, { seen });
    document.addEventListener("scar-stream", (event) => {
      const stream = (event as CustomEvent<ScarStream>).detail;
      const look = () => (seen.most = Math.max(seen.most, stream.stats().memory));
      stream.on("tile", look);
      stream.on("progress", look);
      stream.on("evict", () => seen.evicted++);
    });
  };

  it("keeps within the memory that its address says, and draws", async () => {
    const megabytes = 7;
    await viewing(
      async (page) => {
        await until(page, "still");
        await page.keyboard.press("u");
        await page.keyboard.press("u");
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

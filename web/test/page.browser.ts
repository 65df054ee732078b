/** The viewer page in a real browser: it draws, refines, obeys its keys, and keeps the picture when a server fails. */

import assert from "node:assert/strict";
import { existsSync } from "node:fs";
import { describe, it } from "node:test";
import type { Page } from "puppeteer-core";
import { browsing, lit, message, until } from "./chromium.js";
import { toys } from "./files.js";
import { hosting } from "./hosting.js";
import { type FileServer, serving } from "./server.js";

const PAGE = new URL("../../../scarfmt/viewer/page/", import.meta.url);
const bytes = toys();

/** Runs in a browser with the page open on a scene whose server can be told to misbehave. */
async function viewing(run: (page: Page, server: FileServer) => Promise<void>, prepare?: (server: FileServer) => void) {
  await serving(bytes, async (url, server) => {
    prepare?.(server);
    await hosting(PAGE, url, (address) =>
      browsing(async (page) => {
        await page.goto(`${address}?url=/scene.scar`);
        await run(page, server);
      }),
    );
  });
}

/** Layers that are complete, by the lines of the first panel. */
const complete = (page: Page) => page.$$eval(".panel:first-child tr.complete", (rows) => rows.length);

/** Waits until so many layers are complete and drawn. */
async function untilComplete(page: Page, layers: number): Promise<void> {
  const wanted = `document.querySelectorAll(".panel:first-child tr.complete").length === ${layers}`;
  await page.waitForFunction(wanted, { timeout: 120_000, polling: 100 });
  await until(page, "still");
}

describe("the viewer page", () => {
  it("draws a scene, all layers of it, and asks no one else for anything", async () => {
    await viewing(async (page, server) => {
      await untilComplete(page, 5);
      const sum = await page.$eval(".sum", (told) => told.textContent ?? "");
      assert.equal(sum.includes("in JavaScript"), !existsSync(new URL("scar.wasm", PAGE)), "what decodes is told");
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
      (server) => {
        server.ranges = false;
        server.trick = (_, response) => {
          response.writeHead(200, { "Content-Length": String(bytes.length) });
          response.write(bytes.subarray(0, 60_000));
          release = () => response.end(bytes.subarray(60_000));
          return true;
        };
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

  it("mends a connection that is cut", async () => {
    await viewing(
      async (page, server) => {
        await untilComplete(page, 5);
        assert.ok(server.asked.length > 1);
      },
      (server) => {
        server.trick = ({ range }, response, number) => {
          if (number !== 2 || range === null) return false;
          response.writeHead(206, server.rangeHeaders(range));
          response.write(server.bytes.subarray(range[0], range[0] + 1000), () => response.destroy());
          return true;
        };
      },
    );
  });

  it("says that the file was changed, and keeps what is shown", async () => {
    await viewing(
      async (page) => {
        assert.match(await message(page), /changed/);
        await until(page, "still");
        assert.ok((await lit(page)) > 0.1);
      },
      (server) => {
        server.trick = (_, __, number) => {
          if (number > 1) server.etag = '"two"';
          return false;
        };
      },
    );
  });

  it("says what is damaged, and shows the rest", async () => {
    await viewing(
      async (page) => {
        assert.match(await message(page), /block at byte \d+ arrived damaged/);
        await until(page, "still");
        assert.ok((await lit(page)) > 0.1);
      },
      (server) => {
        server.bytes = server.bytes.slice();
        server.bytes[bytes.length - 3000] ^= 0xff;
      },
    );
  });

  it("says what is no scene", async () => {
    await viewing(
      async (page) => assert.match(await message(page), /signature|not a .scar/),
      (server) => {
        server.bytes = new Uint8Array(5000).fill(7);
      },
    );
  });
});

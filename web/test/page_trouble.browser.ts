/** The viewer page in a real browser, where something is wrong: it keeps the picture, and says what. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { lit, message, until } from "./chromium.js";
import { sharedBrowser } from "./shared_browser.js";
import { bytes, untilComplete, viewingIn } from "./viewing.js";

const viewing = viewingIn(sharedBrowser());

describe("the viewer page in trouble", () => {
  it("says what is damaged, and shows the rest", async () => {
    await viewing(
      async (page) => {
        assert.match(await message(page), /block at byte \d+ arrived damaged/);
        await until(page, "still");
        assert.ok((await lit(page)) > 0.1);
      },
      {
        prepare: (server) => {
          server.bytes = server.bytes.slice();
          server.bytes[bytes.length - 3000] ^= 0xff;
        },
      },
    );
  });

  it("says at once what cannot be reached, while it tries again, and shows the scene once it can", async () => {
    let down = true;
    await viewing(
      async (page) => {
        assert.match(await message(page), /cannot load .*scene.scar: the server answers 503.*Trying again/);
        assert.equal(await page.evaluate("document.body.dataset.state"), "loading");
        assert.equal(await page.evaluate("document.querySelector('.panel').hidden"), true);
        down = false;
        await untilComplete(page, 5);
        assert.equal(await page.evaluate("document.getElementById('message').hidden"), true);
      },
      {
        prepare: (server) => {
          server.trick = (_, response) => {
            if (down) response.writeHead(503).end();
            return down;
          };
        },
      },
    );
  });

  it("says what is not there, and tries again when asked to", async () => {
    let absent = true;
    await viewing(
      async (page) => {
        await until(page, "failed");
        assert.match(await message(page), /the server answers 404/);
        absent = false;
        await page.click("#again");
        await untilComplete(page, 5);
      },
      {
        prepare: (server) => {
          server.trick = (_, response) => {
            if (absent) response.writeHead(404).end();
            return absent;
          };
        },
      },
    );
  });

  it("says whom it waits for", async () => {
    await viewing(
      async (page) => {
        await page.waitForFunction("document.getElementById('loading').textContent.startsWith('Waiting for 127.0.0.1')", { polling: 100 });
      },
      { prepare: (server) => (server.trick = () => true) },
    );
  });

  it("says that the browser cannot decode", async () => {
    await viewing(async (page) => assert.match(await message(page), /no WebAssembly with SIMD/), {
      before: () => (WebAssembly.validate = () => false),
    });
  });
});

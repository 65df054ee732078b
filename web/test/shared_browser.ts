/** One browser for the tests of a file: to start one takes as long as a test. */

import { after } from "node:test";
import type { Browser } from "puppeteer-core";
import { type Browsing, launch, runIn } from "./chromium.js";

/** Each run has a page of a context of its own: nothing that was loaded or kept before. To be called beside the tests. */
export function sharedBrowser(): Browsing {
  let browser: Promise<Browser> | null = null;
  after(async () => (await browser)?.close());
  return async (run, size) => {
    browser ??= launch();
    const context = await (await browser).createBrowserContext();
    try {
      await runIn(await context.newPage(), run, size);
    } finally {
      await context.close();
    }
  };
}

/** A picture of a page when nothing moves on it: `node shot.mjs URL OUT.png WIDTH HEIGHT` */

import { bare, browsing, until } from "./chromium.js";

const [url, path, width, height] = process.argv.slice(2);
await browsing(
  async (page) => {
    await page.goto(url);
    await until(page, "still");
    await bare(page);
    await page.screenshot({ path: path as `${string}.png` });
  },
  { width: Number(width), height: Number(height) },
);

/**
 * A picture of a page when nothing moves on it: `node shot.mjs URL OUT.png WIDTH HEIGHT [whole]`. It is of the scene
 * alone; `whole`: with buttons and panels. The name may end with .jpeg or .webp, too.
 */

import { bare, browsing, until } from "./chromium.js";

const [url, path, width, height, whole] = process.argv.slice(2);
await browsing(
  async (page) => {
    await page.goto(url);
    await until(page, "still");
    if (whole === undefined) await bare(page);
    // Of PNG there is but one quality.
    await page.screenshot({ path: path as `${string}.png`, ...(path.endsWith(".png") ? {} : { quality: 80 }) });
  },
  { width: Number(width), height: Number(height) },
);

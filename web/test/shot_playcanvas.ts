/** A picture of a scene in the example for PlayCanvas: `node shot_playcanvas.mjs SCENE OUT.png WIDTH HEIGHT VIEW` */

import { exampleOf, look, settle, untilLayers, untilTrue } from "./example.js";
import { readBytes } from "./files.js";
import { serving } from "./server.js";

const [scene, path, width, height, view] = process.argv.slice(2);
await serving(readBytes(scene), (url) =>
  exampleOf(
    url,
    async (page) => {
      await untilTrue(page, "resource");
      await look(page, view.split(",").map(Number));
      await untilLayers(page, 1);
      await untilTrue(page, "stream.stats().layerAt.every((at) => at !== null) && !resource.waiting");
      await settle(page);
      await page.screenshot({ path: path as `${string}.png` });
    },
    { size: { width: Number(width), height: Number(height) } },
  ),
);

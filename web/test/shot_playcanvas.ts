/**
 * A picture of a scene in the example for PlayCanvas: `node shot_playcanvas.mjs SCENE OUT.png WIDTH HEIGHT VIEW [DEVICE]`.
 * DEVICE is webgl2 or webgpu; there is no picture where the browser has no adapter for that.
 */

import { writeFileSync } from "node:fs";
import { browsing, browsingWebgpu } from "./chromium.js";
import { ask, exampleOf, look, settle, untilLayers, untilTrue } from "./example.js";
import { readBytes } from "./files.js";

const [scene, path, width, height, view, device = "webgl2"] = process.argv.slice(2);
const size = { width: Number(width), height: Number(height) };

/** In the page: draws into a texture, since no screenshot has a WebGPU canvas in it. */
const DRAWN = `(async () => {
  const device = app.graphicsDevice, { width, height } = device;
  const colorBuffer = new pc.Texture(device, { width, height, format: pc.PIXELFORMAT_RGBA8, mipmaps: false });
  const renderTarget = new pc.RenderTarget({ colorBuffer, depth: true, origin: pc.RENDERTARGET_ORIGIN_TOP });
  app.root.findComponent("camera").renderTarget = renderTarget;
  for (const end = app.frame + 5; app.frame < end; ) await new Promise(requestAnimationFrame);
  const pixels = await colorBuffer.read(0, 0, width, height, { renderTarget, immediate: true });
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  canvas.getContext("2d").putImageData(new ImageData(Uint8ClampedArray.from(pixels), width, height), 0, 0);
  return canvas.toDataURL("image/png").split(",")[1];
})()`;

await exampleOf(
  readBytes(scene),
  async (page) => {
    if (device === "webgpu" && !(await ask<boolean>(page, "app.graphicsDevice.isWebGPU"))) return;
    await untilTrue(page, "resource");
    await look(page, view.split(",").map(Number));
    await untilLayers(page, 1);
    await untilTrue(page, "stream.stats().layerAt.every((at) => at !== null) && !resource.waiting");
    await settle(page);
    writeFileSync(path, await ask<string>(page, DRAWN), "base64");
  },
  { size, device, open: device === "webgpu" ? browsingWebgpu : browsing },
);

/** The example page for PlayCanvas, and what can be asked of it and done in it. */

import type { Page } from "puppeteer-core";
import { type Browsing, browsing, type Size } from "./chromium.js";
import { serving, type FileServer } from "./server.js";

const WEB = new URL("../../", import.meta.url);
/** In which the view is told, and PlayCanvas copies and sorts what was uploaded. */
const SETTLING = { frames: 10, ms: 300 };

/** Runs in a browser with the example open on a scene. @param prepare tells its server what to do */
export async function exampleOf(
  scene: Uint8Array,
  run: (page: Page, server: FileServer) => Promise<void>,
  { size, open = browsing, device = "webgl2", prepare }: { size?: Size; open?: Browsing; device?: string; prepare?: (server: FileServer) => void } = {},
): Promise<void> {
  const opened = async (url: string, server: FileServer) => {
    prepare?.(server);
    await open(async (page) => {
      await page.goto(`${new URL("/", url)}examples/playcanvas.html?url=/scene.scar&device=${device}`);
      await page.waitForFunction("document.readyState === 'complete'");
      await page.evaluate("import('playcanvas').then((found) => (globalThis.pc = found))");
      // A device comes later than the page.
      await page.waitForFunction("pc.app?.root.findByName('camera')", { polling: 50 });
      await run(page, server);
    }, size);
  };
  await serving(scene, opened, WEB);
}

/** An expression of the page in which `app`, `asset`, `resource` and `stream` are those of the example. */
export function ask<Answer>(page: Page, expression: string): Promise<Answer> {
  return page.evaluate(inPage(expression)) as Promise<Answer>;
}

function inPage(expression: string): string {
  return `(() => {
    const { app } = pc, asset = app.assets.find("scene"), resource = asset.resource, stream = resource?.stream;
    return ${expression};
  })()`;
}

/** Waits until an expression is true. */
export async function untilTrue(page: Page, expression: string): Promise<void> {
  await page.waitForFunction(inPage(expression), { polling: 50 });
}

/** Waits until as many layers are there and drawn. */
export async function untilLayers(page: Page, layers: number): Promise<void> {
  await untilTrue(page, `stream?.stats().layerAt.filter((at) => at !== null).length >= ${layers} && !resource.waiting`);
  await settle(page);
}

/** Waits for some frames and some time. */
export async function settle(page: Page): Promise<void> {
  const [frame, now] = await ask<[number, number]>(page, "[app.frame, performance.now()]");
  await untilTrue(page, `app.frame > ${frame + SETTLING.frames} && performance.now() > ${now + SETTLING.ms}`);
}

/** Looks from a place of the scene: position, target, up (its own axes), degrees from top to bottom. */
export async function look(page: Page, view: number[]): Promise<void> {
  await ask(
    page,
    `(() => {
      const [x, y, z, tx, ty, tz, ux, uy, uz, fov] = ${JSON.stringify(view)};
      const place = app.root.findByName("scene").getWorldTransform(), camera = app.root.findByName("camera");
      camera.script.enabled = false;
      camera.camera.fov = fov;
      camera.setPosition(place.transformPoint(new pc.Vec3(x, y, z)));
      camera.lookAt(place.transformPoint(new pc.Vec3(tx, ty, tz)), place.transformVector(new pc.Vec3(ux, uy, uz)));
    })()`,
  );
}

/** Chromium without a window or a GPU, drawing WebGL2 in software, and WebGPU where asked. CHROMIUM names it. */

import puppeteer, { type Browser, type Page } from "puppeteer-core";

const FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"];
/** Dawn is to draw by the same software as the compositor, or it loses its device with the first frame. */
const WEBGPU = ["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader", "--enable-features=Vulkan", "--use-vulkan=swiftshader"];
const PATIENCE_MS = 240_000;

export interface Size {
  width: number;
  height: number;
}

/** Runs with a page; errors of its scripts fail the run. */
export type Browsing = (run: (page: Page) => Promise<void>, size?: Size) => Promise<void>;

export function launch(more: string[] = []): Promise<Browser> {
  return puppeteer.launch({ executablePath: process.env.CHROMIUM, args: [...FLAGS, ...more], protocolTimeout: PATIENCE_MS });
}

/** A page of a browser of its own, which is closed whatever happens. */
export const browsing = browsingWith([]);
/** The same with WebGPU; a page of it may have no adapter. */
export const browsingWebgpu = browsingWith(WEBGPU);

/** @param flags more of Chromium */
export function browsingWith(flags: string[]): Browsing {
  return async (run, size) => {
    const browser = await launch(flags);
    try {
      await runIn(await browser.newPage(), run, size);
    } finally {
      await browser.close();
    }
  };
}

export async function runIn(page: Page, run: (page: Page) => Promise<void>, size?: Size): Promise<void> {
  await page.setViewport(size ?? { width: 480, height: 360 });
  page.setDefaultTimeout(PATIENCE_MS);
  const errors: string[] = [];
  page.on("pageerror", (error) => errors.push(String(error)));
  await run(page);
  if (errors.length > 0) throw new Error(errors.join("\n"));
}

/** Waits until the page is in a state: "reading", "drawing" or "still". */
export async function until(page: Page, state: string): Promise<void> {
  const wanted = `document.body.dataset.state === ${JSON.stringify(state)}`;
  await page.waitForFunction(wanted, { timeout: PATIENCE_MS, polling: 100 });
}

/** Waits for the message that the page shows. */
export async function message(page: Page): Promise<string> {
  await page.waitForFunction("!document.getElementById('message').hidden", { timeout: PATIENCE_MS, polling: 100 });
  return page.$eval("#message span", (span) => span.textContent ?? "");
}

/** Without buttons and panels, so that a picture is the scene alone. */
export async function bare(page: Page): Promise<void> {
  await page.addStyleTag({ content: "nav, aside, #message, #loading { display: none !important }" });
}

/** Bytes of a picture, red, green, blue and opacity; a page decodes it. @param png base64 */
async function pixels(page: Page, png: string): Promise<Buffer> {
  const decoded = await page.evaluate(async (data) => {
    const picture = await createImageBitmap(await (await fetch(`data:image/png;base64,${data}`)).blob());
    const context = new OffscreenCanvas(picture.width, picture.height).getContext("2d")!;
    context.drawImage(picture, 0, 0);
    const { data: rgba } = context.getImageData(0, 0, picture.width, picture.height);
    const parts = Array.from({ length: Math.ceil(rgba.length / 4096) }, (_, i) => rgba.subarray(4096 * i, 4096 * (i + 1)));
    return btoa(parts.map((part) => String.fromCharCode(...part)).join(""));
  }, png);
  return Buffer.from(decoded, "base64");
}

/** Share of the pixels that are brighter than black. */
export async function lit(page: Page): Promise<number> {
  await bare(page);
  const rgba = await pixels(page, await page.screenshot({ encoding: "base64" }));
  let count = 0;
  for (let i = 0; i < rgba.length; i += 4) count += rgba[i] + rgba[i + 1] + rgba[i + 2] > 60 ? 1 : 0;
  return (4 * count) / rgba.length;
}

/** PSNR between two pictures, dB. */
export async function psnr(page: Page, one: string, other: string): Promise<number> {
  const [a, b] = [await pixels(page, one), await pixels(page, other)];
  const squares = a.reduce((sum, x, i) => sum + (x - b[i]) ** 2, 0);
  // Opacity is the same everywhere.
  return 10 * Math.log10((255 ** 2 * 0.75 * a.length) / squares);
}

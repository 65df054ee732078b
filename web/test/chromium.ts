/** Chromium without a window or a GPU, drawing WebGL2 in software. CHROMIUM names it. */

import puppeteer, { type Browser, type Page } from "puppeteer-core";

const FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"];
const PATIENCE_MS = 240_000;

export interface Size {
  width: number;
  height: number;
}

/** Runs with a page; errors of its scripts fail the run. */
export type Browsing = (run: (page: Page) => Promise<void>, size?: Size) => Promise<void>;

export function launch(): Promise<Browser> {
  return puppeteer.launch({ executablePath: process.env.CHROMIUM, args: FLAGS, protocolTimeout: PATIENCE_MS });
}

/** A page of a browser of its own, which is closed whatever happens. */
export const browsing: Browsing = async (run, size) => {
  const browser = await launch();
  try {
    await runIn(await browser.newPage(), run, size);
  } finally {
    await browser.close();
  }
};

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

/** Share of the pixels that are brighter than black. */
export async function lit(page: Page): Promise<number> {
  await bare(page);
  const png = await page.screenshot({ encoding: "base64" });
  return page.evaluate(async (data) => {
    const picture = await createImageBitmap(await (await fetch(`data:image/png;base64,${data}`)).blob());
    const context = new OffscreenCanvas(picture.width, picture.height).getContext("2d")!;
    context.drawImage(picture, 0, 0);
    const { data: rgba } = context.getImageData(0, 0, picture.width, picture.height);
    let count = 0;
    for (let i = 0; i < rgba.length; i += 4) count += rgba[i] + rgba[i + 1] + rgba[i + 2] > 60 ? 1 : 0;
    return (4 * count) / rgba.length;
  }, png);
}

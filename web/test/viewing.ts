/** The viewer page open on a scene whose server can be told to misbehave. */

import type { Page } from "puppeteer-core";
import { type Browsing, until } from "./chromium.js";
import { toys } from "./files.js";
import { type FileServer, serving } from "./server.js";

export const PAGE = new URL("../../../scarfmt/viewer/page/", import.meta.url);
export const bytes = toys();

export interface Setting {
  /** Of the page's address. */
  query?: string;
  scene?: Uint8Array;
  /** Misbehaviour of the server. */
  prepare?: (server: FileServer) => void;
  /** Runs in the page before its scripts. */
  before?: () => unknown;
}

type Run = (page: Page, server: FileServer) => Promise<void>;

/** @returns what runs in a browser with the page open on a scene */
export function viewingIn(browsing: Browsing): (run: Run, setting?: Setting) => Promise<void> {
  return async (run, { query = "url=/scene.scar", scene = bytes, prepare, before } = {}) => {
    const opened = async (url: string, server: FileServer) => {
      prepare?.(server);
      await browsing(async (page) => {
        if (before !== undefined) await page.evaluateOnNewDocument(before);
        await page.goto(`${new URL("/", url)}?${query}`);
        await run(page, server);
      });
    };
    await serving(scene, opened, PAGE);
  };
}

/** Waits until so many layers are complete and drawn. */
export async function untilComplete(page: Page, layers: number): Promise<void> {
  const wanted = `document.querySelectorAll(".panel:first-child tr.complete").length === ${layers}`;
  await page.waitForFunction(wanted, { timeout: 120_000, polling: 100 });
  await until(page, "still");
}

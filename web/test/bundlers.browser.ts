/** The package as npm packs it, in a page of someone else's: by an import map, and by bundlers. It draws, by one three.js. */

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { copyFileSync, mkdirSync, mkdtempSync, rmSync, symlinkSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, describe, it } from "node:test";
import { pathToFileURL } from "node:url";
import * as esbuild from "esbuild";
import { build as buildByVite } from "vite";
import webpack from "webpack";
import { lit, until } from "./chromium.js";
import { toys } from "./files.js";
import { type FileServer, serving } from "./server.js";
import { sharedBrowser } from "./shared_browser.js";

const browsing = sharedBrowser();
const app = mkdtempSync(join(tmpdir(), "scar-app-"));
const packed = join(app, "node_modules/scar-stream");

/** A page that imports three.js, as the package does; its script is `main.js`, or what a bundler makes of it. */
const page = (script: string, head = "") => `<!doctype html>
<meta charset="utf-8"><link rel="icon" href="data:,">${head}
<style>body { margin: 0 } #scene, scar-view { width: 240px; height: 360px; float: left }</style>
<div id="scene"></div>
<script type="module" src="./${script}"></script>`;
const MAIN = `
import { REVISION } from "three";
import { createViewer } from "scar-stream/viewer";
import "scar-stream/element";

const viewer = createViewer({ container: document.getElementById("scene"), url: "/scene.scar" });
const element = document.createElement("scar-view");
element.setAttribute("src", "/scene.scar");
document.body.append(element);
const tell = () => (document.body.dataset.state = element.viewer.state === "still" ? viewer.state : "reading");
viewer.on("state", tell);
element.addEventListener("scar-state", tell);
document.body.dataset.three = REVISION;
`;
const IMPORTS = {
  three: "./node_modules/three/build/three.module.js",
  "three/addons/": "./node_modules/three/examples/jsm/",
  "@sparkjsdev/spark": "./node_modules/@sparkjsdev/spark/dist/spark.module.js",
  "scar-stream/viewer": "./node_modules/scar-stream/dist/viewer.js",
  "scar-stream/element": "./node_modules/scar-stream/dist/element.js",
};

before(() => {
  mkdirSync(packed, { recursive: true });
  const [{ filename }] = JSON.parse(execFileSync("npm", ["pack", "--json", "--pack-destination", app], { encoding: "utf8" }));
  execFileSync("tar", ["-xzf", join(app, filename), "--strip-components=1", "-C", packed]);
  mkdirSync(join(app, "node_modules/@sparkjsdev"));
  for (const name of ["three", "@sparkjsdev/spark"]) symlinkSync(join(process.cwd(), "node_modules", name), join(app, "node_modules", name));
  writeFileSync(join(app, "main.js"), MAIN);
  writeFileSync(join(app, "index.html"), page("main.js", `<script type="importmap">${JSON.stringify({ imports: IMPORTS })}</script>`));
});
after(() => rmSync(app, { recursive: true }));

/** Opens what lies in a folder of the app, and expects that both viewers draw. */
async function assertDraws(folder: string): Promise<void> {
  const draws = (url: string, { missing }: FileServer) =>
    browsing(async (page) => {
      const told: string[] = [];
      page.on("console", (message) => told.push(message.text()));
      await page.goto(String(new URL("/", url)));
      await until(page, "still");
      assert.ok((await lit(page)) > 0.3);
      assert.deepEqual(told, [], "nothing to complain of, such as two copies of three.js");
      assert.deepEqual(missing, []);
    });
  await serving(toys(), draws, pathToFileURL(`${join(app, folder)}/`));
}

/** A folder for what a bundler makes, with a page that loads it. */
function output(name: string): string {
  const folder = join(app, name);
  mkdirSync(folder);
  writeFileSync(join(folder, "index.html"), page("main.js"));
  return folder;
}

describe("the packed package", () => {
  it("draws by an import map", () => assertDraws("."));

  it("draws built by Vite", async () => {
    mkdirSync(join(app, "vite"));
    writeFileSync(join(app, "vite/index.html"), page("../main.js"));
    await buildByVite({ root: join(app, "vite"), logLevel: "error", build: { minify: false, chunkSizeWarningLimit: 1e5 } });
    await assertDraws("vite/dist");
  });

  it("draws built by webpack", async () => {
    const path = output("webpack");
    const stats = await new Promise<webpack.Stats | undefined>((resolve, reject) => {
      const config: webpack.Configuration = { mode: "production", context: app, entry: "./main.js", output: { path }, optimization: { minimize: false }, performance: false };
      webpack(config, (error, stats) => (error ? reject(error) : resolve(stats)));
    });
    assert.deepEqual([stats!.hasErrors(), stats!.hasWarnings()], [false, false]);
    await assertDraws("webpack");
  });

  it("draws built by esbuild, with worker and decoder copied beside its scripts", async () => {
    const outdir = output("esbuild");
    await esbuild.build({ entryPoints: [join(app, "main.js")], bundle: true, format: "esm", splitting: true, outdir, logLevel: "warning" });
    for (const name of ["worker.js", "scar.wasm"]) copyFileSync(join(packed, "dist", name), join(outdir, name));
    await assertDraws("esbuild");
  });
});

/** Builds dist/: the package, its worker, its WebAssembly module and its tests. `node build.mjs` */

import { execFileSync } from "node:child_process";
import { readdirSync, rmSync } from "node:fs";
import { build } from "esbuild";

const ROOT = import.meta.dirname;
/** What tests and people run, beside the tests. */
const PROGRAMS = [
  ...["conformance.ts", "shot.ts", "shot_playcanvas.ts", "times.ts"],
  ...["bundlers.browser.ts", "page.browser.ts", "page_trouble.browser.ts", "playcanvas.browser.ts", "three.browser.ts"],
];
const COMMON = {
  absWorkingDir: ROOT,
  bundle: true,
  format: "esm",
  target: "es2022",
  logLevel: "warning",
  legalComments: "none",
};
const PACKED = { outdir: "dist", minify: true, sourcemap: true, platform: "browser" };

rmSync(`${ROOT}/dist`, { recursive: true, force: true });
await build({
  ...COMMON,
  entryPoints: {
    "scar-stream": "src/index.ts",
    viewer: "src/viewer/viewer.ts",
    element: "src/viewer/element.ts",
    loaders: "src/adapters/loaders.ts",
    three: "src/adapters/three.ts",
    playcanvas: "src/adapters/playcanvas.ts",
  },
  ...PACKED,
  // Of whoever uses the package: two copies of three.js do not work together.
  external: ["three", "@sparkjsdev/spark", "playcanvas"],
  splitting: true,
});
// In one file, so that who copies it need not copy others.
await build({ ...COMMON, ...PACKED, entryPoints: { worker: "src/decoder/worker.ts" } });
execFileSync(`${ROOT}/build_wasm.sh`, [`${ROOT}/dist/scar.wasm`], { stdio: "inherit" });
const tests = readdirSync(`${ROOT}/test`).filter((name) => name.endsWith(".test.ts"));
await build({
  ...COMMON,
  entryPoints: [...PROGRAMS, ...tests].map((name) => `test/${name}`),
  outdir: "dist/tests",
  outExtension: { ".js": ".mjs" },
  sourcemap: "inline",
  external: ["@loaders.gl/core", "esbuild", "puppeteer-core", "vite", "webpack"],
  platform: "node",
});

/** Builds dist/: the package, its worker, its WebAssembly module and its tests. `node build.mjs` */

import { execFileSync } from "node:child_process";
import { readdirSync, rmSync } from "node:fs";
import { build } from "esbuild";

const ROOT = import.meta.dirname;
/** What tests and people run, beside the tests. */
const PROGRAMS = [
  ...["conformance.ts", "dump.ts", "node_worker.ts", "shot.ts", "shot_playcanvas.ts"],
  ...["page.browser.ts", "page_trouble.browser.ts", "playcanvas.browser.ts"],
];
const COMMON = {
  absWorkingDir: ROOT,
  bundle: true,
  format: "esm",
  target: "es2022",
  logLevel: "warning",
  legalComments: "none",
};

rmSync(`${ROOT}/dist`, { recursive: true, force: true });
await build({
  ...COMMON,
  entryPoints: {
    "scar-stream": "src/index.ts",
    spark: "src/adapters/spark.ts",
    playcanvas: "src/adapters/playcanvas.ts",
    worker: "src/decoder/worker.ts",
  },
  outdir: "dist",
  external: ["three", "@sparkjsdev/spark", "playcanvas"],
  splitting: true,
  minify: true,
  sourcemap: true,
  platform: "browser",
});
execFileSync(`${ROOT}/build_wasm.sh`, [`${ROOT}/dist/scar.wasm`], { stdio: "inherit" });
const tests = readdirSync(`${ROOT}/test`).filter((name) => name.endsWith(".test.ts"));
await build({
  ...COMMON,
  entryPoints: [...PROGRAMS, ...tests].map((name) => `test/${name}`),
  outdir: "dist/tests",
  outExtension: { ".js": ".mjs" },
  sourcemap: "inline",
  external: ["puppeteer-core"],
  platform: "node",
});

/** Builds dist/: the package, its workers and its tests. `node build.mjs` */

import { readdirSync, rmSync } from "node:fs";
import { build } from "esbuild";

const ROOT = import.meta.dirname;
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
  entryPoints: { "scar-stream": "src/index.ts", worker: "src/decoder/worker.ts" },
  outdir: "dist",
  splitting: true,
  minify: true,
  sourcemap: true,
  platform: "browser",
});
const tests = readdirSync(`${ROOT}/test`).filter((name) => name.endsWith(".test.ts"));
await build({
  ...COMMON,
  entryPoints: ["dump.ts", "node_worker.ts", "plans.ts", ...tests].map((name) => `test/${name}`),
  outdir: "dist/tests",
  outExtension: { ".js": ".mjs" },
  sourcemap: "inline",
  platform: "node",
});

/** Builds the page of `scarfmt view` into the Python package. `node build_viewer.mjs` */

import { copyFileSync, existsSync, mkdirSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

const ROOT = import.meta.dirname;
const PAGE = `${ROOT}/../scarfmt/viewer/page`;

mkdirSync(PAGE, { recursive: true });
for (const name of readdirSync(PAGE)) rmSync(`${PAGE}/${name}`, { recursive: true });
await build({
  absWorkingDir: ROOT,
  bundle: true,
  format: "esm",
  target: "es2022",
  platform: "browser",
  logLevel: "warning",
  legalComments: "none",
  entryPoints: { viewer: "viewer/viewer.ts", worker: "src/decoder/worker.ts" },
  outdir: PAGE,
  splitting: true,
  minify: true,
});
for (const name of ["index.html", "viewer.css"]) copyFileSync(`${ROOT}/viewer/${name}`, `${PAGE}/${name}`);
// Without a compiler for it there is none, and the page decodes in JavaScript.
const module = `${ROOT}/dist/scar.wasm`;
if (existsSync(module)) copyFileSync(module, `${PAGE}/scar.wasm`);
const bundled = ["three", "@sparkjsdev/spark"];
const licences = bundled.map((name) => `${name}\n\n${readFileSync(`${ROOT}/node_modules/${name}/LICENSE`, "utf8")}`);
writeFileSync(`${PAGE}/licences.txt`, licences.join("\n\n"));

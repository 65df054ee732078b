/** Builds the page of `scarfmt view` into the Python package. `node build_viewer.mjs` */

import { copyFileSync, mkdirSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { gzipSync } from "node:zlib";
import { build } from "esbuild";
import { writeComponents } from "./components.mjs";

const ROOT = import.meta.dirname;
const PAGE = `${ROOT}/../scarfmt/viewer/page`;
const SPARK_MODULE = "spark.wasm";

/**
 * Spark has its WebAssembly as a string of 2 MB in its script. As a file of its own it is a third smaller on its way, is
 * fetched beside the script, and compiled while it is read. Where Spark is built in another way, it stays as it is.
 */
const sparkModule = (address) => ({
  name: "spark-module",
  setup({ onLoad }) {
    onLoad({ filter: /spark\.module(\.min)?\.js$/ }, ({ path }) => {
      const script = readFileSync(path, "utf8");
      const inlined = /const WASM = decode64\("([A-Za-z0-9+/=]+)"\)(?:\.buffer)?;\s*const WASM_MODULE = WebAssembly\.compile\(WASM\);/;
      const found = inlined.exec(script);
      if (found === null) return { contents: script };
      writeFileSync(`${PAGE}/${SPARK_MODULE}`, Buffer.from(found[1], "base64"));
      const fetched = `fetch(${address}).then((answer) => answer.arrayBuffer())`;
      const compiled = `const WASM_MODULE = ${fetched}.then((bytes) => WebAssembly.compile(bytes));`;
      return { contents: script.replace(found[0], compiled) };
    });
  },
});

/** In a page of one file the worker and the modules are in the page. */
const embeddedFiles = {
  name: "embedded-files",
  setup({ onResolve }) {
    onResolve({ filter: /^\.\/files\.js$/ }, () => ({ path: `${ROOT}/viewer/embedded_files.ts` }));
  },
};

/** Scripts that one imports at once, itself first. */
function imported(outputs, path) {
  const found = new Set([path]);
  for (const one of found) {
    for (const { path: other, kind } of outputs[one].imports) if (kind === "import-statement") found.add(other);
  }
  return [...found];
}

/** The page with its style in it. */
function styledPage() {
  const style = `<style>${readFileSync(`${ROOT}/viewer/viewer.css`, "utf8")}</style>`;
  return readFileSync(`${ROOT}/viewer/index.html`, "utf8").replace(/<link rel="stylesheet".*\/>/, () => style);
}

/** The page, which names the scripts that the first picture needs, so that none waits for another that asks for it. */
function writePage({ outputs }) {
  const scripts = imported(outputs, Object.keys(outputs).find((path) => path.endsWith("/page.js")));
  const links = scripts.map((path) => `    <link rel="modulepreload" href="${path.split("/").pop()}" />\n`);
  writeFileSync(`${PAGE}/index.html`, styledPage().replace("  </head>", () => `${links.join("")}  </head>`));
}

mkdirSync(PAGE, { recursive: true });
for (const name of readdirSync(PAGE)) rmSync(`${PAGE}/${name}`, { recursive: true });
const COMMON = {
  absWorkingDir: ROOT,
  bundle: true,
  format: "esm",
  target: "es2022",
  platform: "browser",
  logLevel: "warning",
  legalComments: "none",
  minify: true,
};
const { metafile } = await build({
  ...COMMON,
  entryPoints: { page: "viewer/page.ts", worker: "src/decoder/worker.ts" },
  outdir: PAGE,
  splitting: true,
  metafile: true,
  plugins: [sparkModule(`new URL("./${SPARK_MODULE}", import.meta.url)`)],
});
writePage(metafile);
copyFileSync(`${ROOT}/dist/scar.wasm`, `${PAGE}/scar.wasm`);
writeComponents(PAGE, metafile, SPARK_MODULE);

/** The page of `scarfmt export`: all in one file, the scene to be put in the place of `<!--scene-->`. */
async function writeEmbedded() {
  const plugins = [sparkModule("globalThis.scarFiles.spark"), embeddedFiles];
  const script = async (entry) => (await build({ ...COMMON, entryPoints: [entry], write: false, outdir: PAGE, plugins })).outputFiles[0].contents;
  const parts = {
    page: await script("viewer/page.ts"),
    worker: await script("src/decoder/worker.ts"),
    decoder: readFileSync(`${PAGE}/scar.wasm`),
    spark: readFileSync(`${PAGE}/${SPARK_MODULE}`),
  };
  const data = Object.entries(parts).map(([id, bytes]) => `<script type="text/plain" id="file-${id}">${gzipSync(bytes, { level: 9 }).toString("base64")}</script>\n`);
  const licences = `<script type="text/plain">${readFileSync(`${PAGE}/licences.txt`, "utf8")}</script>\n`;
  const start = `<script type="module">${readFileSync(`${ROOT}/viewer/embedded.js`, "utf8")}</script>`;
  const content = `${licences}${data.join("")}<!--scene-->\n${start}`;
  writeFileSync(`${PAGE}/embedded.html`, styledPage().replace(/<script type="module".*<\/script>/, () => content));
}
await writeEmbedded();

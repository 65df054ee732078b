/** Builds the page of `scarfmt view` into the Python package. `node build_viewer.mjs` */

import { copyFileSync, existsSync, mkdirSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
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

/** Scripts that one imports, itself first; `later` with those that it imports only when it needs them. */
function imported(outputs, path, later) {
  const found = new Set([path]);
  for (const one of found) {
    for (const { path: other, kind } of outputs[one].imports) {
      if (kind === "import-statement" || (later && kind === "dynamic-import")) found.add(other);
    }
  }
  return [...found];
}

/** The page, which names all that the first picture needs, so that nothing waits for the script that asks for it. */
function writePage({ outputs }) {
  const named = (name) => Object.keys(outputs).find((path) => path.endsWith(`/${name}`));
  const drawing = Object.keys(outputs).find((path) => /\/drawing-\w+\.js$/.test(path));
  const scripts = new Set([...imported(outputs, named("page.js")), ...imported(outputs, drawing)]);
  const links = [...scripts].map((path) => `<link rel="modulepreload" href="${path.split("/").pop()}" />`);
  if (existsSync(`${PAGE}/${SPARK_MODULE}`)) {
    links.push(`<link rel="preload" as="fetch" type="application/wasm" crossorigin href="${SPARK_MODULE}" />`);
  }
  const page = readFileSync(`${ROOT}/viewer/index.html`, "utf8");
  writeFileSync(`${PAGE}/index.html`, page.replace("  </head>", `${links.map((link) => `    ${link}\n`).join("")}  </head>`));
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
copyFileSync(`${ROOT}/viewer/viewer.css`, `${PAGE}/viewer.css`);
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
  const style = `<style>${readFileSync(`${PAGE}/viewer.css`, "utf8")}</style>`;
  const licences = `<script type="text/plain">${readFileSync(`${PAGE}/licences.txt`, "utf8")}</script>\n`;
  const start = `<script type="module">${readFileSync(`${ROOT}/viewer/embedded.js`, "utf8")}</script>`;
  const page = readFileSync(`${ROOT}/viewer/index.html`, "utf8")
    .replace(/<link rel="stylesheet".*\/>/, () => style)
    .replace(/<script type="module".*<\/script>/, () => `${licences}${data.join("")}<!--scene-->\n${start}`);
  writeFileSync(`${PAGE}/embedded.html`, page);
}
await writeEmbedded();

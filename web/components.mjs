/** What the page holds of others, found in what was bundled: `components.json` for programs, `licences.txt` for people. */

import { existsSync, readFileSync, writeFileSync } from "node:fs";

const PACKAGES = `${import.meta.dirname}/node_modules`;
/** By crate, its licence. A crate that is not listed ends the build: look its licence up on crates.io. */
const CRATES = JSON.parse(readFileSync(`${import.meta.dirname}/spark_crates.json`, "utf8"));
const IN_PACKAGES = /node_modules\/((?:@[^/]+\/)?[^/]+)\//;
/** Where a crate may panic, its module names the file. */
const IN_CRATE = /index\.crates\.io-\w+\/([\w-]+?)-(\d+\.\d+\.\d+)\/|\b(dlmalloc|rustc-demangle)-(\d+\.\d+\.\d+)\/src/g;

/** npm packages of which a bundle holds at least a byte, by name; those that a package was itself bundled from, too. */
function packagesIn({ outputs }) {
  const inputs = Object.values(outputs).flatMap(({ inputs }) => Object.entries(inputs));
  const paths = inputs.filter(([, { bytesInOutput }]) => bytesInOutput > 0).map(([path]) => path);
  const names = (from) => from.flatMap((path) => IN_PACKAGES.exec(path)?.[1] ?? []);
  const direct = new Set(names(paths));
  const before = new Set(names(paths.flatMap(bundledBefore)));
  return [...new Set([...direct, ...before])].sort().map((name) => described(name, direct.has(name)));
}

/** What a script was bundled from, as the map beside it says. */
function bundledBefore(path) {
  const map = `${import.meta.dirname}/${path}.map`;
  return path.includes("node_modules") && existsSync(map) ? JSON.parse(readFileSync(map, "utf8")).sources : [];
}

/** Of a package that another was bundled from, no map says the version. */
function described(name, direct) {
  const { version, license } = JSON.parse(readFileSync(`${PACKAGES}/${name}/package.json`, "utf8"));
  const text = readFileSync(`${PACKAGES}/${name}/LICENSE`, "utf8");
  return { name, version: direct ? version : null, licence: license, kind: "npm", text };
}

/** Crates that a compiled module names, each once a version. */
function cratesIn(module) {
  const found = new Map();
  for (const match of module.toString("latin1").matchAll(IN_CRATE)) {
    const [name, version] = match[1] ? [match[1], match[2]] : [match[3], match[4]];
    if (CRATES[name] === undefined) throw new Error(`crate ${name} ${version} in Spark's module: add it to spark_crates.json`);
    found.set(`${name} ${version}`, { name, version, licence: CRATES[name], kind: "cargo" });
  }
  return [...found.keys()].sort().map((key) => found.get(key));
}

/**
 * Writes both files into the folder of the page.
 * @param page the folder
 * @param metafile of esbuild
 * @param module file name of Spark's WebAssembly, which may not be there
 */
export function writeComponents(page, metafile, module) {
  const packages = packagesIn(metafile);
  const crates = existsSync(`${page}/${module}`) ? cratesIn(readFileSync(`${page}/${module}`)) : [];
  const components = [...packages.map(({ text, ...facts }) => facts), ...crates];
  writeFileSync(`${page}/components.json`, `${JSON.stringify(components, null, 1)}\n`);
  const texts = packages.map(({ name, version, licence, text }) => `${[name, version ?? []].flat().join(" ")} (${licence})\n\n${text.trim()}\n`);
  if (crates.length > 0) {
    const lines = crates.map(({ name, version, licence }) => `${name} ${version} (${licence})`);
    texts.push(`Rust crates that ${module} of @sparkjsdev/spark names, from https://crates.io:\n\n${lines.join("\n")}\n`);
  }
  writeFileSync(`${page}/licences.txt`, texts.join("\n\n"));
}

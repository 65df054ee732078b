#!/usr/bin/env bash
# loaders.gl knows a file by its first bytes, but looks for them before it where the file is a view into a larger buffer.
#
# One would expect: a loader that is found for an ArrayBuffer to be found for a Uint8Array or a Node Buffer of the same bytes.
# What happens: a test that is text is compared with the view. A test that is bytes, or a function, gets the whole buffer
#   that the view is of. So it misses the file, or takes what lies before it for the file.
# Package: @loaders.gl/core 4.5.4 (npm). Date: 2026-11-28.
# Why it matters: Node's small Buffers, members of archives and parts of a download are such views. Give loaders tests that
#   are text, with "\x89" and the like for bytes, or copy what is to be recognised.
# Output seen:
#   text:     ArrayBuffer found, view at its start found, view behind other bytes found, view behind the magic none
#   bytes:    ArrayBuffer found, view at its start found, view behind other bytes none, view behind the magic found
#   function: ArrayBuffer found, view at its start found, view behind other bytes none, view behind the magic found
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @loaders.gl/core@4.5.4 >>npm.log
cat >views.mjs <<'JS'
import { selectLoaderSync } from "@loaders.gl/core";

const MAGIC = "MAGIC";
const bytes = (text) => new TextEncoder().encode(text);
const TESTS = {
  "text:    ": MAGIC,
  "bytes:   ": bytes(MAGIC).buffer,
  "function:": (data) => new TextDecoder().decode(new Uint8Array(data, 0, MAGIC.length)) === MAGIC,
};
const FILES = {
  "ArrayBuffer": bytes("MAGIC, the file").buffer,
  "view at its start": bytes("MAGIC, the file"),
  "view behind other bytes": bytes("other MAGIC, the file").subarray(6),
  // None: another file lies before it.
  "view behind the magic": bytes("MAGIC another file").subarray(6),
};
const options = { core: { ignoreRegisteredLoaders: true, nothrow: true } };
const loader = { name: "a", id: "a", module: "a", version: "1", extensions: ["none"], mimeTypes: [], options: {}, binary: true };
let asDescribed = true;
for (const [kind, test] of Object.entries(TESTS)) {
  const found = Object.values(FILES).map((file) => selectLoaderSync(file, [{ ...loader, tests: [test] }], options)?.id === "a");
  console.log(kind, Object.keys(FILES).map((name, i) => `${name} ${found[i] ? "found" : "none"}`).join(", "));
  asDescribed &&= String(found) === (typeof test === "string" ? "true,true,true,false" : "true,true,false,true");
}
process.exit(asDescribed ? 0 : 1);
JS
node views.mjs

// Compiles scar.ksy to the Python parser that the tests use: `make ksy`, after every change of scar.ksy.
import { createHash } from "node:crypto";
import { readFileSync, writeFileSync } from "node:fs";
import { load } from "js-yaml";
import compiler from "kaitai-struct-compiler";

const [source, target] = process.argv.slice(2);
const text = readFileSync(source, "utf8");
const files = await compiler.compile("python", load(text), null, false);
const digest = createHash("sha256").update(text).digest("hex");
writeFileSync(target, `# Made by \`make ksy\` from scar.ksy, sha256 ${digest}\n${files["scar.py"]}`);

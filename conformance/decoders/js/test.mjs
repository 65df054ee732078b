/** The vectors of conformance/vectors, as PROTOCOL.md says what passes: `node --test test.mjs`. */

import assert from "node:assert/strict";
import { existsSync, readdirSync, readFileSync } from "node:fs";
import { dirname, join, relative } from "node:path";
import { describe, it } from "node:test";
import { fileURLToPath } from "node:url";

import { answer } from "./answers.js";

const VECTORS = join(dirname(fileURLToPath(import.meta.url)), "../../vectors");

/** Bytes, then zeros up to a length, without holding them. */
function extendedSource(bytes, length) {
  const read = (offset, n) => {
    const part = new Uint8Array(n);
    if (offset < bytes.length) part.set(bytes.subarray(offset, Math.min(offset + n, bytes.length)));
    return part;
  };
  return { length, read };
}

function ask(source, layers, stage, camera) {
  return JSON.parse([...answer(source, { layers, stage, camera })].join(""));
}

/** @returns {string[]} folders that hold an expectation */
function vectorFolders(folder) {
  if (existsSync(join(folder, "expect.json"))) return [folder];
  const inside = readdirSync(folder, { withFileTypes: true }).filter((entry) => entry.isDirectory());
  return inside.flatMap(({ name }) => vectorFolders(join(folder, name)));
}

/** Activated values: reference and, if present, magnitude, binary64 one after the other. */
function compareActivated(folder, name, wanted, found) {
  assert.deepEqual(found.shape, wanted.shape, name);
  const numbers = (bytes) => new Float64Array(Uint8Array.from(bytes).buffer);
  const stored = numbers(readFileSync(join(folder, wanted.reference)));
  const n = wanted.shape.reduce((a, b) => a * b, 1);
  const reference = stored.subarray(0, n);
  const magnitude = wanted.magnitude ? stored.subarray(n) : reference;
  const values = numbers(Buffer.from(found.data, "base64"));
  const quaternions = name.endsWith("rotation");
  for (let i = 0; i < n; i++) {
    const row = reference.subarray(4 * Math.floor(i / 4), 4 * Math.floor(i / 4) + 4);
    if (quaternions && !row.some(Number.isFinite)) continue;
    const [a, b] = [values[i], reference[i]];
    const m = Math.max(Math.abs(b), Math.abs(magnitude[i]));
    if (a === b || Number.isNaN(b) || !Number.isFinite(m)) continue;
    assert.ok(Math.abs(a - b) <= 1e-5 * Math.max(1, m), `${name}[${i}]: ${a}, not ${b}`);
  }
}

function compareLayer(folder, stages, found) {
  for (const [stage, wanted] of Object.entries(stages)) {
    if (stage === "container") assert.deepEqual(found[stage].container, wanted.container);
    for (const [name, array] of Object.entries(wanted.arrays ?? {})) {
      const mine = found[stage].arrays[name];
      assert.ok(mine, `${stage}: no ${name}`);
      if (stage === "activated") compareActivated(folder, name, array, mine);
      else assert.deepEqual({ ...mine, first: array.first }, array, `${stage}: ${name}`);
    }
  }
}

function checkVector(folder, expect) {
  const bytes = new Uint8Array(readFileSync(join(folder, "input.scar")));
  const source = extendedSource(bytes, expect.extend_to ?? bytes.length);
  if (expect.result === "refused") {
    assert.equal(ask(source, 0, expect.stage === "metadata" ? "metadata" : "all").refused, expect.refusal);
    return;
  }
  if (expect.result === "either") {
    const found = ask(source, 0, "all");
    if (found.refused !== undefined) assert.ok(expect.refusals.includes(found.refused), found.refused);
    else if (expect.layers) compareLayer(folder, expect.layers.at(-1).stages, found.stages);
    return;
  }
  for (const { layer, stages } of expect.layers) {
    const found = ask(source, layer, "all", expect.camera);
    assert.equal(found.refused, undefined, found.message);
    compareLayer(folder, stages, found.stages);
  }
  if (expect.metadata !== undefined) {
    assert.deepEqual(ask(source, 0, "metadata").stages.metadata.metadata, expect.metadata);
  }
}

describe("conformance vectors", () => {
  for (const folder of vectorFolders(VECTORS)) {
    const expect = JSON.parse(readFileSync(join(folder, "expect.json"), "utf8"));
    if (expect.format !== "scar-conformance 2") continue;
    it(`${relative(VECTORS, folder)}: ${expect.purpose}`, () => checkVector(folder, expect));
  }
});

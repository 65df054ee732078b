/** The WebAssembly decoder against the one in JavaScript, and what only it has: memory of its own. */

import assert from "node:assert/strict";
import { once } from "node:events";
import { createServer } from "node:http";
import type { AddressInfo } from "node:net";
import { describe, it } from "node:test";
import { createJsDecoder } from "../src/decoder/js.js";
import { loadDecoder } from "../src/decoder/load.js";
import type { PackedTile, Refusal, TileValues } from "../src/decoder/types.js";
import { loadModule } from "../src/decoder/shared_module.js";
import { createWasmDecoder } from "../src/decoder/wasm.js";
import { WasmModule } from "../src/decoder/wasm_module.js";
import { packWords } from "../src/pack/words.js";
import { Feeder } from "./feeding.js";
import { compiledModule, readBytes, toys, vector } from "./files.js";

const compiled = compiledModule();
const feeder = (bytes: Uint8Array) => new Feeder(createWasmDecoder(compiled), bytes);

const SCENES = {
  "a scene of 24 tiles": toys,
  "an index network": () => vector("valid/index-modes"),
  "a two-level head": () => vector("valid/index-two-level"),
  "predictors and latents": () => vector("valid/latents-predicted"),
  "attention": () => vector("valid/index-attention"),
  "anchors": () => vector("valid/anchors-neural"),
};

/** Within what binary32 gives of the reference, and colours of 0 to 1 within a tenth of an 8-bit step. */
function assertNear(found: Float32Array, wanted: Float32Array, what: string): void {
  assert.equal(found.length, wanted.length, what);
  for (let i = 0; i < found.length; i++) {
    const off = Math.abs(found[i] - wanted[i]);
    assert.ok(off <= 2e-5 * Math.max(1, Math.abs(wanted[i])), `${what}[${i}]: ${found[i]}, not ${wanted[i]}`);
  }
}

function assertSame(found: TileValues, wanted: TileValues): void {
  const { centres, scales, quats, opacity, sh, ...rest } = wanted;
  for (const [name, value] of Object.entries(rest)) assert.equal(found[name as keyof TileValues], value, name);
  assertNear(found.centres, centres, "centres");
  assertNear(found.scales, scales, "scales");
  assertNear(found.quats, quats, "quats");
  assertNear(found.opacity, opacity, "opacity");
  assertNear(found.sh, sh, "sh");
}

/** Halves of words 3 to 5, scales and rotation, may be a step apart, as they come from logarithms and roots. */
function assertPacked(found: PackedTile, wanted: PackedTile): void {
  const { geometry, ...rest } = wanted;
  for (const [name, value] of Object.entries(rest)) assert.deepEqual(found[name as keyof PackedTile], value, name);
  assert.equal(found.geometry.length, geometry.length);
  for (let i = 0; i < geometry.length; i++) {
    const [a, b] = [found.geometry[i], geometry[i]];
    const apart = [(a & 0xffff) - (b & 0xffff), (a >>> 16) - (b >>> 16)].map(Math.abs);
    const most = i % 8 >= 3 && i % 8 <= 5 ? 1 : 0;
    const text = `word ${i}: ${a.toString(16)}, not ${b.toString(16)}`;
    assert.ok(apart.every((steps) => steps <= most || steps === 0xffff), text);
  }
}

describe("the decoder in WebAssembly", () => {
  for (const [name, read] of Object.entries(SCENES)) {
    it(`gives after each layer what JavaScript gives: ${name}`, async () => {
      const bytes = read();
      const one = feeder(bytes);
      const other = new Feeder(await createJsDecoder(), bytes);
      const tile = one.tiles - 1;
      for (let k = 1; k <= one.layers; k++) {
        for (const each of [one, other]) {
          each.addModels(k);
          each.advance(tile, k);
        }
        const values = one.decoder.values(tile, [1, 2, 3]);
        assertSame(values, other.decoder.values(tile, [1, 2, 3]));
        assertPacked(one.decoder.packed(tile, "words", [1, 2, 3]), packWords(values));
      }
    });
  }

  it("does not need a tile to follow as soon as models arrive", () => {
    const [early, late] = [feeder(toys()), feeder(toys())];
    for (let k = 1; k <= 4; k++) late.addModels(k);
    for (let k = 1; k <= 4; k++) {
      early.addModels(k);
      early.advance(4, k);
      late.advance(4, k);
      assert.deepEqual(late.decoder.values(4), early.decoder.values(4));
    }
  });

  it("refuses a damaged tile by its id, forgets it, and goes on with the others", () => {
    const one = feeder(toys());
    const { decoder } = one;
    one.addModels(1);
    one.advance(0, 1);
    const before = decoder.values(0);
    const held = decoder.memory();
    const damaged = one.block(1, 1);
    damaged.body[damaged.body.length - 1] ^= 1;
    const isRefusal = (error: Refusal) => error.id === "crc-mismatch" && error instanceof Error;
    assert.throws(() => decoder.advance(1, one.cube(1), damaged), isRefusal);
    assert.throws(() => decoder.values(1), RangeError);
    assert.ok(decoder.memory() <= held);
    assert.deepEqual(decoder.values(0), before);
    one.advance(1, 1);
    assert.ok(decoder.values(1).count > 0);
  });

  it("refuses models by their id", () => {
    const one = feeder(toys());
    const blocks = one.blocks(1).filter(({ kind }) => kind !== 1);
    assert.throws(() => one.decoder.addModels(1, blocks), (error: Refusal) => error.id === "missing-block");
  });

  it("keeps the layers before one whose models are refused", () => {
    const [one, sound] = [feeder(toys()), feeder(toys())];
    for (const each of [one, sound]) {
      each.addModels(1);
      each.advance(0, 1);
    }
    const blocks = one.blocks(2);
    blocks[0].body[0] = 7;
    const isRefusal = (error: Refusal) => error.id === "unsupported-entropy-mode";
    assert.throws(() => one.decoder.addModels(2, blocks), isRefusal);
    for (const each of [one, sound]) each.advance(1, 1);
    for (const tile of [0, 1]) assert.deepEqual(one.decoder.values(tile), sound.decoder.values(tile));
    for (const each of [one, sound]) {
      each.addModels(2);
      each.advance(0, 2);
    }
    assert.deepEqual(one.decoder.values(0), sound.decoder.values(0));
  });

  it("throws RangeError for calls out of order", () => {
    const one = feeder(toys());
    assert.throws(() => one.addModels(2), RangeError);
    assert.throws(() => one.advance(0, 1), RangeError);
    one.addModels(1);
    one.addModels(2);
    assert.throws(() => one.advance(0, 2), RangeError);
    assert.throws(() => one.advance(one.tiles, 1), RangeError);
    one.advance(0, 1);
    assert.throws(() => one.advance(0, 1), RangeError);
    one.advance(0, 2);
    assert.equal(one.decoder.values(0).layer, 2);
  });

  it("gives memory back when tiles are released, and uses it again", () => {
    const one = feeder(toys());
    const { decoder } = one;
    const all = [...Array(one.tiles).keys()];
    for (let k = 1; k <= one.layers; k++) one.addModels(k);
    const fill = () => all.forEach((tile) => [1, 2, 3, 4, 5].forEach((k) => one.advance(tile, k)));
    fill();
    all.forEach((tile) => decoder.release(tile));
    const empty = decoder.memory();
    fill();
    assert.ok(decoder.memory() > empty + 50 * 10914);
    all.forEach((tile) => decoder.release(tile));
    assert.equal(decoder.memory(), empty);
  });

  it("gives arrays of their own, which later calls leave alone", () => {
    const one = feeder(toys());
    one.addModels(1);
    one.advance(0, 1);
    one.advance(1, 1);
    const values = one.decoder.values(0);
    const copy = structuredClone(values);
    one.decoder.values(1);
    assert.deepEqual(values, copy);
    assert.equal(values.centres.buffer.byteLength, values.centres.byteLength);
  });
});

describe("the module", () => {
  it("is fetched and compiled, and an answer that is none is an error", async () => {
    const bytes = readBytes("dist/scar.wasm");
    const server = createServer((request, response) => {
      response.statusCode = request.url === "/scar.wasm" ? 200 : 404;
      response.end(bytes);
    });
    await once(server.listen(0, "127.0.0.1"), "listening");
    const address = `http://127.0.0.1:${(server.address() as AddressInfo).port}`;
    assert.ok((await loadModule(`${address}/scar.wasm`)) instanceof WebAssembly.Module);
    await assert.rejects(loadModule(`${address}/other.wasm`), /status 404/);
    server.close();
  });

  it("is not needed: JavaScript decodes where it cannot be had", async () => {
    const one = new Feeder(await loadDecoder(), toys());
    one.addModels(1);
    one.advance(0, 1);
    const other = new Feeder(await createJsDecoder(), toys());
    other.addModels(1);
    other.advance(0, 1);
    assert.deepEqual(one.decoder.values(0), other.decoder.values(0));
  });

  it("imports nothing", () => {
    assert.deepEqual(WebAssembly.Module.imports(compiled), []);
  });

  it("refuses what there is no memory for, and goes on", () => {
    const module = new WasmModule(compiled);
    const noRoom = (error: Refusal) => error.id === "limit-memory";
    assert.throws(() => module.call((f) => f.scar_take(-1)), noRoom);
    const parts: number[] = [];
    assert.throws(() => {
      for (;;) parts.push(module.call((f) => f.scar_take(2 ** 29)));
    }, noRoom);
    for (const part of parts) module.call((f) => f.scar_give(part));
    assert.equal(module.call((f) => f.scar_memory()), 0);
    assert.ok(module.put(new Uint8Array(1000)) > 0);
  });

  it("joins free memory, in whatever order it is given back", () => {
    const module = new WasmModule(compiled);
    const take = (n: number) => module.call((f) => f.scar_take(n));
    const give = (at: number) => module.call((f) => f.scar_give(at));
    const parts = [1000, 5000, 300, 70000, 64, 9000].map(take);
    const end = take(1);
    for (const i of [3, 0, 5, 1, 4, 2]) give(parts[i]);
    assert.equal(take(85_000), parts[0]);
    assert.ok(take(85_000) > end);
  });
});

/** The decoder: its words and values agree, calls and refusals keep the rules, memory is given back. */

import assert from "node:assert/strict";
import { once } from "node:events";
import { createServer } from "node:http";
import type { AddressInfo } from "node:net";
import { describe, it } from "node:test";
import { loadModule } from "../src/decoder/shared_module.js";
import type { PackedTile, TileValues } from "../src/decoder/types.js";
import { WasmModule } from "../src/decoder/wasm_module.js";
import { LN_SCALE_MIN, LN_SCALE_STEPS, OPACITY_STEPS } from "../src/pack/words.js";
import { Feeder } from "./feeding.js";
import { compiledModule, readBytes, toys, vector } from "./files.js";

const compiled = compiledModule();
const feeder = (bytes: Uint8Array) => new Feeder(bytes);
const SH_0 = 0.28209479177387814;

const SCENES = {
  "a scene of 24 tiles": toys,
  "predictors and latents": () => vector("valid/latents-predicted"),
  "anchors": () => vector("valid/anchors-neural"),
};

function fromHalf(bits: number): number {
  const sign = bits & 0x8000 ? -1 : 1;
  const [exponent, fraction] = [(bits >> 10) & 31, bits & 1023];
  return sign * (exponent === 0 ? fraction * 2 ** -24 : (1024 + fraction) * 2 ** (exponent - 25));
}

function near(found: number, wanted: number, most: number, what: string): void {
  assert.ok(Math.abs(found - wanted) <= most, `${what}: ${found}, not ${wanted}`);
}

/** Gaussian i of words, read as the shaders of the adapters read it, is that of the values within a step. */
function assertGeometry(words: PackedTile, values: TileValues, i: number): void {
  const w = words.geometry.slice(8 * i, 8 * i + 8);
  assert.deepEqual(new Float32Array(w.buffer).slice(0, 3), values.centres.slice(3 * i, 3 * i + 3));
  [w[3] & 0xffff, w[3] >>> 16, w[4] & 0xffff].forEach((steps, axis) => {
    const scale = Math.max(values.scales[3 * i + axis], Math.exp(LN_SCALE_MIN));
    near(Math.exp(steps / LN_SCALE_STEPS + LN_SCALE_MIN) / scale, 1, 0.0005, `scale of ${i}`);
  });
  const quat = [(w[4] | 0) >> 16, (w[5] << 16) >> 16, (w[5] | 0) >> 16].map((k) => (k * Math.SQRT1_2) / 32767);
  quat.splice((w[7] >>> 16) & 3, 0, Math.sqrt(Math.max(0, 1 - quat.reduce((sum, k) => sum + k * k, 0))));
  const wanted = values.quats.subarray(4 * i, 4 * i + 4);
  near(Math.abs(quat.reduce((sum, q, k) => sum + q * wanted[k], 0)), 1, 1e-6, `rotation of ${i}`);
  const width = 3 * (values.shDegree + 1) ** 2;
  [w[6] & 0xffff, w[6] >>> 16, w[7] & 0xffff].forEach((half, c) => {
    near(fromHalf(half), 0.5 + SH_0 * values.sh[width * i + c], 1e-3, `colour of ${i}`);
  });
  near((w[7] >>> 18) / OPACITY_STEPS, values.opacity[i], 1 / OPACITY_STEPS, `opacity of ${i}`);
}

function assertHarmonics(words: PackedTile, values: TileValues, i: number): void {
  const own = words.harmonics.slice(4 * words.shDegree * i, 4 * words.shDegree * (i + 1));
  const width = 3 * (words.shDegree + 1) ** 2;
  const wanted = values.sh.subarray(width * i + 3, width * (i + 1));
  const peak = Math.max(...wanted.map(Math.abs));
  const step = fromHalf(own[own.length - 1] >>> 16) / 127;
  const bytes = new Int8Array(own.buffer);
  wanted.forEach((x, k) => near(bytes[k] * step, x, peak / 200, `coefficient ${k} of ${i}`));
}

describe("the decoder", () => {
  for (const [name, read] of Object.entries(SCENES)) {
    it(`gives words of what it gives as values, after each layer: ${name}`, () => {
      const one = feeder(read());
      const tile = one.tiles - 1;
      for (let k = 1; k <= one.layers; k++) {
        one.addModels(k);
        one.advance(tile, k);
        const values = one.decoder.values(tile, [1, 2, 3]);
        const words = one.decoder.packed(tile, [1, 2, 3]);
        assert.deepEqual([words.tile, words.layer, words.count, words.shDegree], [tile, k, values.count, values.shDegree]);
        assert.deepEqual([words.geometry.length, words.harmonics.length], [8 * values.count, 4 * values.shDegree * values.count]);
        for (let i = 0; i < values.count; i++) {
          assertGeometry(words, values, i);
          if (words.shDegree > 0) assertHarmonics(words, values, i);
        }
      }
    });
  }

  it("refuses a damaged tile by its id, forgets it, and goes on with the others", () => {
    const one = feeder(toys());
    const { decoder } = one;
    one.addModels(1);
    one.advance(0, 1);
    const before = decoder.values(0);
    const held = decoder.memory();
    const damaged = one.block(1, 1);
    damaged.body[damaged.body.length - 1] ^= 1;
    const isRefusal = { id: "crc-mismatch" };
    assert.throws(() => decoder.advance(1, one.cube(1), damaged), isRefusal);
    assert.throws(() => decoder.values(1), RangeError);
    assert.deepEqual(decoder.values(0), before);
    assert.ok(decoder.memory() <= held, "the next call gave back what the tile had");
    one.advance(1, 1);
    assert.ok(decoder.values(1).count > 0);
  });

  it("keeps the layers before one whose models are refused", () => {
    const [one, sound] = [feeder(toys()), feeder(toys())];
    for (const each of [one, sound]) {
      each.addModels(1);
      each.advance(0, 1);
    }
    const blocks = one.blocks(2);
    blocks[0].body[0] = 7;
    const isRefusal = { id: "rans-seal" };
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

  it("imports nothing", () => {
    assert.deepEqual(WebAssembly.Module.imports(compiled), []);
  });

  it("refuses what there is no memory for, and goes on", () => {
    const module = new WasmModule(compiled);
    const noRoom = { id: "limit-memory" };
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

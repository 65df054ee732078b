/** The JavaScript decoder, layer by layer: it keeps integers, places and promises. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { STREAM } from "../../conformance/decoders/js/constants.js";
import { openScar } from "../../conformance/decoders/js/decoder.js";
import { createJsDecoder } from "../src/decoder/js.js";
import type { Refusal, TileValues } from "../src/decoder/types.js";
import { Feeder } from "./feeding.js";
import { toys, vector } from "./files.js";

const feeder = async (bytes: Uint8Array) => new Feeder(await createJsDecoder(), bytes);

/** A tile decoded in one go to a layer, as the conformance decoder gives it. */
function direct(bytes: Uint8Array, number: number, layers: number) {
  const scar = openScar(bytes);
  const [tile] = scar.tiles({ layers, tiles: [number] });
  const exact = scar.exactValues(tile);
  return { exact, activated: scar.activatedValues(tile, exact) as Record<string, Float64Array> };
}

const SCENES = {
  "a scene of 24 tiles": toys,
  "an index network": () => vector("valid/index-modes"),
  "predictors and latents": () => vector("valid/latents-predicted"),
  attention: () => vector("valid/index-attention"),
};

describe("the decoder in JavaScript", () => {
  for (const [name, read] of Object.entries(SCENES)) {
    it(`gives after each layer what a decode from the first gives: ${name}`, async () => {
      const bytes = read();
      const one = await feeder(bytes);
      const tile = one.tiles - 1;
      for (let k = 1; k <= one.layers; k++) {
        one.addModels(k);
        one.advance(tile, k);
        const found = one.decoder.values(tile);
        const { exact, activated } = direct(bytes, tile, k);
        assert.equal(found.layer, k);
        assert.deepEqual(found.centres, Float32Array.from(exact.position));
        assert.deepEqual(found.scales, Float32Array.from(exact.values.get(STREAM.SCALE)!, Math.exp));
        assert.deepEqual(found.quats, Float32Array.from(activated.rotation));
        assert.deepEqual(found.opacity, Float32Array.from(activated.opacity));
        assert.deepEqual(found.sh, Float32Array.from(activated.sh));
      }
    });
  }

  it("does not need a tile to follow as soon as models arrive", async () => {
    const early = await feeder(toys());
    const late = await feeder(toys());
    for (let k = 1; k <= 3; k++) late.addModels(k);
    for (let k = 1; k <= 3; k++) {
      early.addModels(k);
      early.advance(4, k);
      late.advance(4, k);
      assert.deepEqual(late.decoder.values(4), early.decoder.values(4));
    }
  });

  it("keeps the index of an anchor from layer to layer", async () => {
    const one = await feeder(toys());
    const before: TileValues[] = [];
    for (let k = 1; k <= one.layers; k++) {
      one.addModels(k);
      one.advance(7, k);
      before.push(one.decoder.values(7));
    }
    const [first] = before;
    const last = before.at(-1)!;
    assert.ok(first.count > 0 && last.count > first.count);
    const moved = first.centres.map((x, i) => Math.abs(x - last.centres[i]));
    assert.ok(Math.max(...moved) < 0.01, "an anchor moves by less than a cell");
  });

  it("bakes the anchor profile for a camera, slots that are off at opacity 0", async () => {
    const bytes = vector("valid/anchors");
    const one = await feeder(bytes);
    one.decodeTo(one.layers);
    const eye: [number, number, number] = [1, -2, 3];
    const found = one.decoder.values(0, eye);
    const scar = openScar(bytes);
    const [tile] = scar.tiles({ tiles: [0] });
    const wanted = scar.activatedValues(tile, scar.exactValues(tile), eye) as Record<string, Float64Array>;
    assert.equal(found.count, tile.size * scar.header.slots);
    const drawn = [...found.opacity.keys()].filter((i) => tile.slotLayer[i] > 0 && wanted["gaussian.opacity"][i] > 0);
    assert.ok(drawn.length > 0 && drawn.length < found.count);
    for (const i of found.opacity.keys()) {
      assert.equal(found.opacity[i], drawn.includes(i) ? Math.fround(wanted["gaussian.opacity"][i]) : 0);
    }
    const colour = found.sh.map((c) => 0.5 + 0.28209479177387814 * c);
    colour.forEach((c, i) => assert.ok(Math.abs(c - wanted["gaussian.colour"][i]) < 1e-6));
    assert.notDeepEqual(one.decoder.values(0, [5, 5, 5]).opacity, found.opacity);
  });

  it("forgets a tile that is released, and decodes it again", async () => {
    const one = await feeder(toys());
    one.decodeTo(2);
    const held = one.decoder.memory();
    const values = one.decoder.values(3);
    one.decoder.release(3);
    assert.ok(one.decoder.memory() < held);
    assert.throws(() => one.decoder.values(3), RangeError);
    one.advance(3, 1);
    one.advance(3, 2);
    assert.deepEqual(one.decoder.values(3), values);
    assert.equal(one.decoder.memory(), held);
  });

  it("refuses damaged blocks by rule and goes on with other tiles", async () => {
    const one = await feeder(toys());
    one.addModels(1);
    const damaged = one.block(2, 1);
    damaged.body[damaged.body.length - 1] ^= 1;
    assert.throws(
      () => one.decoder.advance(2, one.cube(2), damaged),
      (error: Refusal) => error.id === "crc-mismatch" && error.offset !== null,
    );
    assert.throws(() => one.decoder.values(2), RangeError);
    one.advance(2, 1);
    one.advance(5, 1);
    assert.ok(one.decoder.values(2).count > 0 && one.decoder.values(5).count > 0);
  });

  it("wants calls in order", async () => {
    const one = await feeder(toys());
    assert.throws(() => one.addModels(2), RangeError);
    assert.throws(() => one.advance(0, 1), RangeError);
    one.addModels(1);
    assert.throws(() => one.addModels(1), RangeError);
    assert.throws(() => one.advance(0, 2), RangeError);
    assert.throws(() => one.advance(one.tiles, 1), RangeError);
    const unopened = await createJsDecoder();
    assert.throws(() => unopened.addModels(1, []), RangeError);
  });
});

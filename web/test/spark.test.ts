/** The adapter for Spark, without a GPU: what it writes into textures, where, and how much of it in a frame. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import type { WebGLRenderer } from "three";
import { ScarSplats, UPLOAD_BYTES } from "../src/adapters/spark.js";
import type { PackedTile } from "../src/decoder/types.js";
import { inRuns, Places, RUN } from "../src/pack/places.js";

const WIDTH = 4096;
const DEGREE = 3;

/** As much of a renderer as the adapter uses; its textures are arrays. */
class Recorder {
  readonly textures = new Map<object, Uint32Array>();
  /** Bytes written since someone looked. */
  written = 0;
  #bound: Uint32Array = new Uint32Array(0);
  readonly capabilities = { maxTextureSize: 8192 };
  readonly properties = { get: (texture: object) => ({ __webglTexture: texture }) };
  readonly state = {
    activeTexture: () => undefined,
    bindTexture: (_: number, texture: object) => (this.#bound = this.textures.get(texture)!),
    unbindTexture: () => undefined,
  };

  initTexture(texture: { image: { width: number; height: number } }): void {
    this.textures.set(texture, new Uint32Array(4 * texture.image.width * texture.image.height));
  }

  getContext(): object {
    const texSubImage2D = (...given: [...number[], Uint32Array]) => {
      const [, , x, y, width, height] = given as unknown as number[];
      const data = given.at(-1) as Uint32Array;
      assert.equal(data.length, 4 * width * height);
      assert.ok(x + width <= WIDTH);
      for (let row = 0; row < height; row++) {
        this.#bound.set(data.subarray(4 * width * row, 4 * width * (row + 1)), 4 * (WIDTH * (y + row) + x));
      }
      this.written += data.byteLength;
    };
    return { texSubImage2D, bindBuffer: () => undefined, pixelStorei: () => undefined };
  }
}

/** A tile whose words all differ. */
function tileOf(count: number, tile = 0): PackedTile {
  const words = (width: number, from: number) => Uint32Array.from({ length: width * count }, (_, i) => from + i);
  return { tile, layer: 1, count, shDegree: DEGREE, geometry: words(8, 1), harmonics: words(4 * DEGREE, 1e8) };
}

function made(total: number): { splats: ScarSplats; recorder: Recorder; geometry: Uint32Array; harmonics: Uint32Array } {
  const recorder = new Recorder();
  const splats = new ScarSplats(recorder as unknown as WebGLRenderer, total, DEGREE);
  const [geometry, harmonics] = [...recorder.textures.values()];
  return { splats, recorder, geometry, harmonics };
}

describe("tiles on their way to the GPU", () => {
  it("are written in parts that a frame has time for, and are whole in the end", () => {
    const [before, count] = [5 * 256, 60_000];
    const { splats, recorder, geometry, harmonics } = made(before + inRuns(count) + 1024);
    splats.put(tileOf(before - 3, 1));
    while (splats.upload());
    recorder.written = 0;
    const earlier = geometry.slice(0, 8 * before);
    const words = tileOf(count);
    const told: PackedTile[] = [];
    splats.onWritten = (tile) => told.push(tile);
    splats.put(words);
    let frames = 0;
    for (; splats.upload(); frames++) {
      assert.ok(recorder.written <= UPLOAD_BYTES, `${recorder.written} bytes in a frame`);
      assert.equal(told.length, splats.waiting ? 0 : 1);
      recorder.written = 0;
    }
    assert.equal(frames, Math.ceil((words.geometry.byteLength + words.harmonics.byteLength) / UPLOAD_BYTES));
    assert.deepEqual(told, [words]);
    assert.deepEqual(geometry.subarray(8 * before, 8 * (before + count)), words.geometry);
    assert.deepEqual(harmonics.subarray(4 * DEGREE * before, 4 * DEGREE * (before + count)), words.harmonics);
    assert.deepEqual(geometry.subarray(0, 8 * before), earlier, "nothing beside it");
    assert.ok(geometry.subarray(8 * (before + count)).every((word) => word === 0), "nothing behind it");
  });

  it("are not written any more once they are cleared, and what was written draws nothing", () => {
    const { splats, geometry } = made(inRuns(30_000));
    splats.put(tileOf(30_000));
    splats.upload();
    splats.clear(0);
    assert.equal(splats.waiting, false);
    assert.ok(geometry.every((word) => word === 0));
  });
});

describe("places", () => {
  it("stay when a tile grows, and are as few as hold it", () => {
    const places = new Places(8 * RUN);
    assert.deepEqual(places.take(7, 10), [{ first: 0, count: 10 }]);
    assert.deepEqual(places.take(8, RUN), [{ first: RUN, count: RUN }]);
    assert.deepEqual(places.take(7, RUN + 5), [
      { first: 0, count: RUN },
      { first: 2 * RUN, count: 5 },
    ]);
    assert.deepEqual(places.give(7), [
      { first: 0, count: RUN },
      { first: 2 * RUN, count: RUN },
    ]);
    assert.deepEqual(places.give(7), []);
    assert.deepEqual(places.take(9, 1), [{ first: 0, count: 1 }]);
  });
});

/** The adapter for Spark, without a GPU: what it writes into textures, where, and how much of it in a frame. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import type { WebGLRenderer } from "three";
import { ScarSplats, UPLOAD_BYTES } from "../src/adapters/spark.js";
import type { PackedTile } from "../src/decoder/types.js";

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
    const [base, count] = [1234, 60_000];
    const { splats, recorder, geometry, harmonics } = made(base + count + 100);
    const words = tileOf(count);
    const told: PackedTile[] = [];
    splats.onWritten = (tile) => told.push(tile);
    splats.put(base, words);
    let frames = 0;
    for (; splats.upload(); frames++) {
      assert.ok(recorder.written <= UPLOAD_BYTES, `${recorder.written} bytes in a frame`);
      assert.equal(told.length, splats.waiting ? 0 : 1);
      recorder.written = 0;
    }
    assert.equal(frames, Math.ceil((words.geometry.byteLength + words.harmonics.byteLength) / UPLOAD_BYTES));
    assert.deepEqual(told, [words]);
    assert.deepEqual(geometry.subarray(8 * base, 8 * (base + count)), words.geometry);
    assert.deepEqual(harmonics.subarray(4 * DEGREE * base, 4 * DEGREE * (base + count)), words.harmonics);
    assert.ok(geometry.subarray(0, 8 * base).every((word) => word === 0), "nothing beside it");
    assert.ok(geometry.subarray(8 * (base + count)).every((word) => word === 0), "nothing behind it");
  });

  it("share a frame where they are small", () => {
    const { splats, recorder } = made(20_000);
    for (let tile = 0; tile < 20; tile++) splats.put(1000 * tile, tileOf(1000, tile));
    let frames = 0;
    for (; splats.upload(); frames++) {
      assert.ok(recorder.written <= UPLOAD_BYTES);
      recorder.written = 0;
    }
    assert.equal(frames, 2);
  });

  it("are not written any more once they are cleared, and what was written draws nothing", () => {
    const { splats, geometry } = made(30_000);
    splats.put(0, tileOf(30_000));
    splats.upload();
    splats.clear(0, 0, 30_000);
    assert.equal(splats.waiting, false);
    assert.ok(geometry.every((word) => word === 0));
  });
});

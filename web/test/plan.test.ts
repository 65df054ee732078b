/** The order of fetching for a view: what is in the picture first, what looks larger before what looks smaller. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { byView } from "../src/plan/by_view.js";
import type { Camera, FileIndex } from "../src/plan/types.js";

/** Cubes of side 2 with their middles on the z axis. */
function row(...depths: number[]): FileIndex {
  const boxes = Float64Array.from(depths.flatMap((z) => [-1, -1, z - 1, 1, 1, z + 1]));
  const tiles = depths.length;
  const empty = { bytes: new Float64Array(2 * tiles).fill(1000), counts: new Uint32Array(2 * tiles).fill(10), slots: 1 };
  return { tiles, layers: 2, boxes, streaming: null, ...empty };
}

const camera: Camera = { position: [0, 0, 0], forward: [0, 0, 1], up: [0, -1, 0], fovY: 1, width: 640, height: 480 };

/** Steps as "tile:layer". */
const plan = (index: FileIndex, from: Camera | null = camera, have = new Uint8Array(index.tiles)) =>
  byView.plan(index, from, have).map(({ tile, layer }) => `${tile}:${layer}`);

describe("a plan for a view", () => {
  it("has layer 1 of all that is in the picture before anything else, the largest first", () => {
    assert.deepEqual(plan(row(50, 5, -20, 10)), ["1:1", "3:1", "0:1", "1:2", "3:2", "0:2", "2:1", "2:2"]);
  });

  it("goes on from what is there", () => {
    assert.deepEqual(plan(row(50, 5), camera, Uint8Array.of(1, 2)), ["0:2"]);
  });

  it("is the order of the file before there is a view", () => {
    const index = row(50, 5);
    assert.deepEqual(plan(index, null), ["0:1", "1:1", "0:2", "1:2"]);
  });

  it("looks from where a camera that moves will be", () => {
    assert.equal(plan(row(50, 5))[0], "1:1");
    assert.equal(plan(row(50, 5), { ...camera, velocity: [0, 0, 80] })[0], "0:1");
  });

  it("takes the box that the file names, and how far splats stick out of it", () => {
    const index = row(6, 5);
    assert.equal(plan(index)[0], "1:1");
    const boxes = { low: new Uint8Array(6), high: new Uint8Array(6).fill(255) };
    boxes.high.set([0, 0, 0], 3);
    index.streaming = { tiles: 2, view: null, ...boxes, reach: new Uint8Array(2) };
    assert.equal(plan(index)[0], "0:1");
    index.streaming.reach[1] = 140;
    assert.equal(plan(index)[0], "1:1");
  });
});

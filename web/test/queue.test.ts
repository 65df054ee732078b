/** Whose turn it is: the tile whose next layer stands first in the plan. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { Queue } from "../src/stream/queue.js";

const steps = (text: string) => text.split(" ").map((one) => ({ tile: Number(one[0]), layer: Number(one[2]) }));

describe("the queue of decoders", () => {
  it("follows the plan, not the arrival", () => {
    const queue = new Queue(3, 3);
    queue.setPlan(steps("2:1 0:1 1:1 1:2 0:2 2:2"));
    for (const tile of [0, 1, 2]) queue.add(tile);
    assert.deepEqual(queue.inOrder(Uint8Array.of(0, 0, 0)), [2, 0, 1]);
    assert.deepEqual(queue.inOrder(Uint8Array.of(1, 1, 1)), [1, 0, 2]);
    queue.delete(1);
    assert.deepEqual(queue.inOrder(Uint8Array.of(1, 1, 1)), [0, 2]);
    assert.equal(queue.size, 2);
  });

  it("takes a tile as far as no other has its turn", () => {
    const queue = new Queue(2, 4);
    queue.setPlan(steps("0:1 0:2 1:1 0:3 1:2 0:4"));
    queue.add(0);
    queue.add(1);
    assert.equal(queue.turnEnd(0, Uint8Array.of(0, 0)), 2);
    assert.equal(queue.turnEnd(0, Uint8Array.of(2, 1)), 3);
    queue.delete(1);
    assert.equal(queue.turnEnd(0, Uint8Array.of(0, 0)), 4);
  });
});

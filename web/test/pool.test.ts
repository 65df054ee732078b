/** Decoders side by side: none waits for the page between two tiles, and none has more than its share. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import type { ChannelEvents, MakeChannel } from "../src/decoder/channel.js";
import type { Request } from "../src/decoder/protocol.js";
import { Pool } from "../src/stream/pool.js";

/** Workers that answer when they are told to. */
class Workers {
  readonly asked: Request[][] = [];
  readonly #events: ChannelEvents[] = [];
  readonly make: MakeChannel = (events) => {
    const requests: Request[] = [];
    this.asked.push(requests);
    this.#events.push(events);
    return { post: (request) => void requests.push(request), close: () => undefined };
  };

  async answer(worker: number): Promise<void> {
    const { id } = this.asked[worker].shift()!;
    this.#events[worker].onReply({ id, memory: 0, took: 1, result: null, failure: null });
    await new Promise((resolve) => setImmediate(resolve));
  }
}

const cube = { depth: 0, shift: 0, prefix: 0n };

/** Gives tiles from `first` on, as many as the pool takes. */
function fill(pool: Pool, first: number): number {
  let tile = first;
  for (; pool.isFree(tile); tile++) void pool.run({ tile, cube, layers: [], output: "words", last: false });
  return tile - first;
}

describe("a pool", () => {
  for (const ahead of [1, 2]) {
    it(`gives each of its decoders ${ahead} at once, and the next when one is answered`, async () => {
      const workers = new Workers();
      const pool = new Pool(3, workers.make, () => assert.fail("no worker failed"), ahead);
      assert.equal(fill(pool, 0), 3 * ahead);
      assert.deepEqual(workers.asked.map(({ length }) => length), [ahead, ahead, ahead]);
      assert.equal(pool.hasFree, false);
      await workers.answer(1);
      assert.equal(fill(pool, 100), 1);
      assert.deepEqual(workers.asked.map(({ length }) => length), [ahead, ahead, ahead]);
      pool.close();
    });
  }
});

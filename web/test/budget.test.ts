/** Budgets: memory and Gaussians stay within them, what is looked at stays, what is not looked at goes. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import type { Planner, Step } from "../src/plan/types.js";
import { evictionOrder, goals } from "../src/stream/budget.js";
import { toys } from "./files.js";
import { serving } from "./server.js";
import { assertComplete, assertShown, cameraAt, streaming, watching } from "./watching.js";

const bytes = toys();

/** Tile by tile, nearest first, all layers of one before the next; tiles are ranked by their number's distance to x. */
const nearest: Planner = {
  plan({ tiles, layers }, camera, have) {
    const x = camera?.position[0] ?? 0;
    const order = [...Array(tiles).keys()].sort((a, b) => Math.abs(a - x) - Math.abs(b - x) || a - b);
    const steps: Step[] = [];
    for (const tile of order) for (let layer = have[tile] + 1; layer <= layers; layer++) steps.push({ tile, layer });
    return steps;
  },
};

const cost = {
  splats: (_tile: number, layer: number) => 10 * layer,
  bytes: (_tile: number, layer: number) => 100 * layer,
};
const steps = (text: string): Step[] => text.split(" ").map((one) => ({ tile: Number(one[0]), layer: Number(one[2]) }));

describe("goals", () => {
  it("follow the plan to the first step that does not fit", () => {
    const ideal = steps("0:1 1:1 1:2 2:1 0:2");
    const all = { splats: Infinity, bytes: Infinity };
    assert.deepEqual([...goals(ideal, 3, cost, all)], [2, 2, 1]);
    assert.deepEqual([...goals(ideal, 3, cost, { ...all, bytes: 350 })], [1, 2, 0]);
    assert.deepEqual([...goals(ideal, 3, cost, { ...all, splats: 20 })], [1, 1, 0]);
    assert.deepEqual([...goals(ideal, 3, cost, { ...all, splats: 0 })], [0, 0, 0]);
  });

  it("say who goes first: what may not be shown at all, of least use first, then what shows too much", () => {
    const ideal = steps("0:1 1:1 2:1 3:1 0:2");
    const order = evictionOrder(ideal, Uint8Array.of(2, 1, 1, 1, 1), Uint8Array.of(1, 1, 0, 0, 0));
    assert.deepEqual(order, [4, 3, 2, 0]);
  });
});

describe("a stream with budgets", () => {
  it("never shows more Gaussians, and shows the nearest whole", async () => {
    await streaming(bytes, { planner: nearest, camera: cameraAt(5), budgets: { splats: 3000 } }, async (watched) => {
      watched.stream.on("tile", () => assert.ok(watched.stream.stats().splatsShown <= 3000));
      const stats = await watched.end();
      assert.ok(stats.splatsShown > 2000, `${stats.splatsShown} Gaussians`);
      assert.equal(watched.shown.get(5)!.layer, 5);
      assert.equal(watched.shown.has(23), false);
      assert.ok(stats.bytesRead < bytes.length);
      assertShown(watched.shown, bytes);
    });
  });

  for (const [name, ranges, most, decoders] of [
    ["with two decoders", true, 7_000_000, { workers: 2 }],
    ["without ranges", false, 4_500_000, {}],
    ["on one thread", true, 4_500_000, {}],
  ] as const) {
    it(`keeps within its memory while the view wanders, ${name}`, async () => {
      await serving(bytes, async (url, server) => {
        server.ranges = ranges;
        const options = { planner: nearest, camera: cameraAt(0), budgets: { bytes: most }, replanMs: 0, ...decoders };
        await watching(url, options, async (watched) => {
          const { stream } = watched;
          let peak = 0;
          for (const event of ["tile", "evict", "progress"] as const) {
            stream.on(event, () => (peak = Math.max(peak, stream.stats().memory)));
          }
          await watched.end();
          assert.ok(watched.shown.size < 24);
          for (const x of [20, 3, 23, 10]) {
            stream.setView(cameraAt(x));
            await watched.end();
            assert.equal(watched.shown.get(x)?.layer, 5, `tile ${x} is shown whole`);
            assertShown(watched.shown, bytes);
          }
          assert.ok(watched.evicted > 0);
          assert.ok(stream.stats().memory <= most, `${stream.stats().memory} bytes in the end`);
          // What WebAssembly takes for tables of a layer when it first needs them is learnt when it has them.
          assert.ok(peak <= 1.15 * most, `${peak} bytes`);
          assert.ok(peak > most / 3, `${peak} bytes`);
          assert.deepEqual(watched.errors, []);
        });
      });
    });
  }

  it("goes on when it is given more, and lets go when it is given less", async () => {
    await streaming(bytes, { planner: nearest, camera: cameraAt(12), budgets: { splats: 2500 } }, async (watched) => {
      const first = await watched.end();
      watched.stream.setBudget({ splats: Infinity });
      await watched.end();
      assertComplete(watched, bytes);
      watched.stream.setBudget({ splats: 2500 });
      const last = await watched.end();
      assert.ok(last.splatsShown <= 2500);
      assert.ok(first.splatsShown > 0 && last.splatsShown > 0);
      assert.equal(watched.shown.get(12)!.layer, 5);
      assertShown(watched.shown, bytes);
    });
  });

  it("shows nothing where nothing fits, and says that it is done", async () => {
    await streaming(bytes, { budgets: { bytes: 1 } }, async (watched) => {
      const stats = await watched.end();
      assert.equal(stats.tilesShown, 0);
      assert.deepEqual(watched.errors, []);
    });
  });
});

/** What tiles cost. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { inRuns } from "../src/pack/places.js";
import { Ledger } from "../src/stream/ledger.js";
import { MemoryModel } from "../src/stream/memory.js";
import { Tiles } from "../src/stream/tiles.js";
import { openedFront, toys } from "./files.js";

const bytes = toys();
const made = (output: "values" | "words" = "values") =>
  new MemoryModel(new Tiles(openedFront(bytes), false), output);

describe("memory", () => {
  it("that decoders hold besides anchors is room to work in, once it was seen", () => {
    const model = made();
    model.addModels(50_000);
    for (const anchors of [1000, 4000, 0, 700]) model.observe(50_000 + 1_000_000 + 320 * anchors, anchors);
    assert.equal(model.fixed, 1_050_000);
  });

  it("is what was delivered, and what a decoder keeps unless the tile is complete", () => {
    const model = made();
    const n = model.splats(4, 3);
    assert.equal(model.bytes(4, 3), n * (4 * 59 + 320));
    assert.equal(model.bytes(4, 5), model.splats(4, 5) * 4 * 59);
    assert.equal(made("words").bytes(4, 5), inRuns(model.splats(4, 5)) * 80);
    assert.equal(model.bytes(4, 0), 0);
  });

  it("is charged for the dearest layer on the way to the goal, and for what is there once it is reached", () => {
    const model = made();
    const ledger = new Ledger(24, model);
    const dearest = Math.max(...[1, 2, 3, 4, 5].map((layer) => model.bytes(4, layer)));
    assert.deepEqual(ledger.growth(4, 0, 5), { bytes: dearest, splats: model.splats(4, 5) });
    ledger.charge(4, 0, 5);
    assert.equal(ledger.bytes, dearest);
    assert.equal(ledger.isOnItsWay(4, 0), true);
    ledger.charge(4, 5, 5);
    assert.deepEqual([ledger.bytes, ledger.splats], [model.bytes(4, 5), model.splats(4, 5)]);
    assert.equal(ledger.isOnItsWay(4, 5), false);
    ledger.charge(4, 0, 0);
    assert.deepEqual([ledger.bytes, ledger.splats], [0, 0]);
  });
});

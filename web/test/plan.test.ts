/** The order of fetching: that of the planner in Python, and something sensible whatever a file says. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { describe, it } from "node:test";
import { answer, type PlanCase } from "./planning.js";

const cases: PlanCase[] = JSON.parse(readFileSync(join(process.cwd(), "test/data/plans.json"), "utf8"));

describe("a plan for a view", () => {
  it("is what the planner in Python says", () => {
    assert.ok(cases.length > 5);
    for (const asked of cases) assert.deepEqual(answer(asked), asked.steps);
  });

  it("goes by what tiles look like where a block cannot be meant", () => {
    const asked = cases.find(({ annotation, camera }) => annotation !== null && camera !== null);
    assert.ok(asked);
    const silent = answer({ ...asked, annotation: null });
    assert.deepEqual(answer({ ...asked, annotation: "c29vbg==" }), silent);
    // Of a file with another number of tiles.
    const other = cases.find(({ annotation, tiles }) => annotation !== null && tiles !== asked.tiles);
    assert.ok(other);
    assert.deepEqual(answer({ ...asked, annotation: other.annotation }), silent);
  });
});

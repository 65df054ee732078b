/** What measures the page: a network that is no faster than it says, and tasks as a trace has them. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { toys } from "./files.js";
import { serving } from "./server.js";
import { ShapedNetwork } from "./shaped.js";
import { longTasks } from "./trace.js";

describe("a slow network", () => {
  it("brings every byte, to all connections together no faster than it may", async () => {
    const bytes = toys();
    await serving(bytes, async (url) => {
      const network = new ShapedNetwork(Number(new URL(url).port), 1e6, 20);
      const address = `http://127.0.0.1:${await network.start()}/scene.scar`;
      try {
        const started = performance.now();
        const answers = await Promise.all([0, 1, 2].map(async () => (await fetch(address)).arrayBuffer()));
        const seconds = (performance.now() - started) / 1000;
        for (const answer of answers) assert.equal(Buffer.compare(new Uint8Array(answer), bytes), 0);
        // A round trip for the connection, one for the question; what the link had ready when bytes came is little.
        assert.ok(seconds > (0.98 * 3 * bytes.length) / 1e6 + 0.04, `${seconds} s`);
        assert.ok(network.delivered > 3 * bytes.length);
      } finally {
        network.stop();
      }
    });
  });
});

describe("tasks of a trace", () => {
  const event = (name: string, ts: number, dur: number, tdur: number, tid = 1, pid = 7) => ({ name, ph: "X", pid, tid, ts, dur, tdur });
  const told = (traceEvents: object[]) => new TextEncoder().encode(JSON.stringify({ traceEvents }));

  it("are those of the page's main thread, in its time", () => {
    const mark = { name: "here", ph: "R", pid: 7, tid: 1, ts: 1_000_000 };
    const own = event("ThreadControllerImpl::RunTask", 1_020_000, 60_000, 12_000);
    const others = [
      event("RunTask", 1_020_000, 90_000, 90_000, 2),
      event("RunTask", 1_020_000, 90_000, 90_000, 1, 8),
      event("FunctionCall", 1_020_000, 50_000, 9_000),
      event("RunTask", 1_200_000, 7_000, 7_000),
    ];
    assert.deepEqual(longTasks(told([mark, own, ...others]), "here", 500), [[520, 60, 12]]);
  });

  it("cannot be told without the mark", () => {
    assert.throws(() => longTasks(told([]), "here", 0), /no mark/);
  });
});

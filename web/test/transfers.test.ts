/** Transfers against a source that waits to be told: how much is under way, and when nothing is. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { Meter } from "../src/stream/meter.js";
import { requestSizes } from "../src/stream/requests.js";
import type { Body, ByteSource } from "../src/stream/source.js";
import { Transfers } from "../src/stream/transfers.js";
import { openedFront, toys } from "./files.js";

const bytes = toys();
const front = openedFront(bytes);
const all = [...front.entries.length.keys()].filter((e) => e >= front.pageEntries && front.entries.length[e] > 0);
const CHUNK = 1000;

/** Gives a chunk of each body whenever `step` is called. */
class SteppedSource implements ByteSource {
  readonly name = "steps";
  readonly size = bytes.length;
  readonly signals: AbortSignal[] = [];
  readonly asked: [number, number][] = [];
  opened = 0;
  pulled = 0;
  #gates: (() => void)[] = [];

  constructor(readonly ranged: boolean) {}

  async open(offset: number, length: number, signal: AbortSignal): Promise<Body> {
    const [start, end] = this.ranged ? [offset, offset + length] : [0, bytes.length];
    this.asked.push([start, end]);
    this.signals.push(signal);
    return { offset: start, chunks: this.#chunks(start, end, signal) };
  }

  /** Lets every body give its next chunk. */
  async step(): Promise<void> {
    for (const open of this.#gates.splice(0)) open();
    await new Promise((resolve) => setImmediate(resolve));
  }

  async *#chunks(start: number, end: number, signal: AbortSignal): AsyncGenerator<Uint8Array, void, void> {
    this.opened++;
    let open = () => undefined as void;
    signal.addEventListener("abort", () => open());
    try {
      for (let at = start; at < end; at += CHUNK) {
        await new Promise<void>((resolve) => {
          open = resolve;
          this.#gates.push(resolve);
        });
        signal.throwIfAborted();
        this.pulled++;
        yield bytes.subarray(at, Math.min(at + CHUNK, end));
      }
    } finally {
      this.opened--;
    }
  }
}

function transfersOf(source: SteppedSource) {
  const taken: number[] = [];
  const failures: string[] = [];
  const meter = new Meter(() => 0);
  const events = {
    onBlock: (entry: number) => void taken.push(entry),
    onDamaged: (entry: number) => void failures.push(`damaged ${entry}`),
    onFailure: ({ id }: { id: string }) => void failures.push(id),
    onRetry: ({ id }: { id: string }) => void failures.push(id),
    onIdle: () => undefined,
  };
  const transfers = new Transfers(source, front, meter, events, { retries: 3, firstMs: 1, mostMs: 1 });
  return { transfers, taken, failures, meter };
}

describe("transfers", () => {
  it("take what is wanted later where its bytes come anyway", async () => {
    const source = new SteppedSource(true);
    const { transfers, taken, meter } = transfersOf(source);
    Object.defineProperty(meter, "capacity", { value: 1000 });
    const { offset, length } = front.entries;
    // Two with one between them that is wanted last of all, farther down the plan than one looks.
    const small = (e: number) => length[e + 1] > 0 && length[e + 1] < 2000 && length[e] + length[e + 1] + length[e + 2] < 20_000;
    const near = all.find((e) => e > all[20] && small(e))!;
    const far = all.filter((e) => e < near || e > near + 2);
    transfers.want([near, near + 2, ...far, near + 1]);
    while (!transfers.idle) await source.step();
    assert.deepEqual(taken.filter((e) => e >= near && e <= near + 2), [near, near + 1, near + 2]);
    const asked = source.asked.filter(([start, end]) => start <= offset[near + 1] && end > offset[near + 1]);
    assert.equal(asked.length, 1, "its bytes were asked for once");
    transfers.close();
  });

  it("have no more under way than a quarter of a second brings, in at most four requests", async () => {
    const source = new SteppedSource(true);
    const { transfers, taken, failures, meter } = transfersOf(source);
    // As slow as 100 kbit/s, so that the file is many times what may be under way.
    Object.defineProperty(meter, "capacity", { get: () => 12_500 });
    const { underWay, most } = requestSizes(12_500, 0);
    transfers.want(all);
    let largest = 0;
    while (taken.length < all.length) {
      assert.ok(source.opened <= 4);
      largest = Math.max(largest, transfers.underWay);
      await source.step();
    }
    const block = Math.max(...front.entries.length);
    assert.ok(largest > underWay / 2 && largest < underWay + Math.max(most, block), `${largest} bytes under way`);
    assert.deepEqual(failures, []);
    assert.deepEqual(
      taken.toSorted((a, b) => a - b),
      all,
    );
  });

  it("stop reading a whole file while they are held, and go on afterwards", async () => {
    const source = new SteppedSource(false);
    const { transfers, taken } = transfersOf(source);
    transfers.want(all);
    for (let i = 0; i < 20; i++) await source.step();
    transfers.hold(true);
    await source.step();
    const pulled = source.pulled;
    for (let i = 0; i < 20; i++) await source.step();
    assert.equal(source.pulled, pulled);
    transfers.hold(false);
    while (taken.length < all.length) await source.step();
    assert.equal(source.asked.length, 1);
  });

  it("ask for nothing more while they are held, and but once while decoders are under way", async () => {
    const source = new SteppedSource(true);
    const { transfers } = transfersOf(source);
    transfers.hold(true);
    transfers.alone = true;
    transfers.want(all);
    await source.step();
    assert.equal(source.asked.length, 0);
    transfers.hold(false);
    await source.step();
    assert.equal(source.asked.length, 1);
    transfers.close();
  });

  it("fetch again what is let go, and only that", async () => {
    const source = new SteppedSource(true);
    const { transfers, taken } = transfersOf(source);
    transfers.want(all);
    while (taken.length < all.length) await source.step();
    const asked = source.asked.length;
    const entry = all[5];
    transfers.forget(entry);
    await source.step();
    assert.equal(transfers.idle, true, "what was let go is not wanted");
    transfers.want(all);
    while (taken.length < all.length + 1) await source.step();
    assert.equal(taken.at(-1), entry);
    const { offset, length } = front.entries;
    assert.deepEqual(source.asked.slice(asked), [[offset[entry], offset[entry] + length[entry]]]);
  });
});

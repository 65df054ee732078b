/** Which bytes are asked for: neighbours together, nothing far down the plan, nothing too large. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { Assembler } from "../src/stream/assembler.js";
import { Backoff } from "../src/stream/backoff.js";
import { StreamError } from "../src/stream/errors.js";
import { Meter } from "../src/stream/meter.js";
import { nextRequest, requestSizes } from "../src/stream/requests.js";
import { crc32 } from "../src/format/crc32.js";

/** Ten blocks of 10 kB that touch each other. */
const entries = { offset: [...Array(10).keys()].map((i) => 1000 + 10_000 * i), length: Array(10).fill(10_000) };
const sizes = { window: 100_000, most: 100_000, gap: 10_000 };

describe("a request", () => {
  it("takes neighbours along that are wanted soon", () => {
    assert.deepEqual(nextRequest([5, 0, 4, 6, 9], entries, sizes), { start: 41_000, end: 71_000, entries: [4, 5, 6] });
  });

  it("reads over a gap that is narrow enough, and over no wider one", () => {
    assert.deepEqual(nextRequest([2, 4], entries, sizes).entries, [2, 4]);
    assert.deepEqual(nextRequest([2, 4], entries, { ...sizes, gap: 9_999 }).entries, [2]);
    assert.deepEqual(nextRequest([4, 2], entries, sizes), { start: 21_000, end: 51_000, entries: [2, 4] });
  });

  it("is no larger than it may be, unless one block is", () => {
    assert.deepEqual(nextRequest([0, 1, 2, 3], entries, { ...sizes, most: 25_000 }).entries, [0, 1]);
    assert.deepEqual(nextRequest([3, 4], entries, { ...sizes, most: 5_000 }).entries, [3]);
  });

  it("looks only so far down the plan", () => {
    assert.deepEqual(nextRequest([3, 8, 4], entries, { ...sizes, window: 20_000 }).entries, [3]);
    assert.deepEqual(nextRequest([3, 8, 4], entries, { ...sizes, window: 20_001 }).entries, [3, 4]);
  });

  it("has sizes that follow throughput and delay", () => {
    const slow = requestSizes(50_000, 0.05);
    const fast = requestSizes(1_250_000, 0.05);
    assert.ok(Math.abs(fast.underWay - 1_250_000 * 0.275) < 1);
    assert.deepEqual([slow.underWay, slow.most, slow.gap], [65_536, 32_768, 4096]);
    assert.ok(fast.most <= 256 * 1024 && fast.gap >= slow.gap && requestSizes(1e8, 0.1).gap === 16_384);
  });
});

describe("throughput", () => {
  it("knows what the link can bring while it mostly waits for questions", () => {
    let now = 0;
    const meter = new Meter(() => now);
    assert.equal(meter.capacity, 1.25e6);
    for (let i = 0; i < 20; i++) {
      now += 300;
      for (let j = 0; j < 10; j++) {
        now += 10;
        meter.add(10_000);
      }
    }
    assert.ok(Math.abs(meter.capacity - 1e6) < 1e5, `${meter.capacity} bytes a second`);
    for (let i = 0; i < 30; i++) {
      now += 100;
      meter.add(1000);
    }
    assert.ok(meter.capacity < 50_000, `${meter.capacity} bytes a second once the link has become slow`);
  });

  it("knows the least of the last delays", () => {
    const meter = new Meter(() => 0);
    assert.equal(meter.delay, 0);
    for (const delay of [20, 50, 60, 60, 60, 60, 60, 60, 60]) meter.firstByte(delay);
    assert.equal(meter.delay, 0.05);
  });
});

describe("blocks that pass", () => {
  const body = (e: number) => Uint8Array.from({ length: 50 + e }, (_, i) => 7 * e + i);
  const lengths = [0, 1, 2, 3].map((e) => body(e).length);
  const made = {
    offset: Float64Array.from(lengths, (_, e) => 10 + lengths.slice(0, e).reduce((a, b) => a + b, 0)),
    length: Float64Array.from(lengths),
    crc32: Uint32Array.from(lengths, (_, e) => crc32(body(e))),
  };
  const file = new Uint8Array(10 + lengths.reduce((a, b) => a + b, 0));
  lengths.forEach((_, e) => file.set(body(e), made.offset[e]));

  for (const size of [1, 7, 60, 1000]) {
    it(`are whole however the bytes are cut: ${size}`, () => {
      const taken = new Map<number, Uint8Array | null>();
      const one = new Assembler(
        made,
        0,
        (e) => e !== 2,
        (e, found) => taken.set(e, found),
      );
      for (let at = 0; at < file.length; at += size) one.push(file.subarray(at, at + size));
      assert.deepEqual(
        [...taken],
        [0, 1, 3].map((e) => [e, body(e)]),
      );
      assert.equal(one.position, file.length);
    });
  }
});

describe("trying again", () => {
  const options = { retries: 4, firstMs: 100, mostMs: 300 };
  const error = (id: string, status?: number) => new StreamError(id, "", { status });

  it("waits twice as long each time, up to a most, with some chance in it", () => {
    const longest = new Backoff(options, () => 1);
    assert.deepEqual(
      [0, 1, 2, 3, 4].map(() => longest.failed(error("cut"))),
      [100, 200, 300, 300, null],
    );
    assert.equal(new Backoff(options, () => 0).failed(error("cut")), 50);
  });

  it("begins anew after something useful", () => {
    const one = new Backoff(options, () => 1);
    one.failed(error("stalled"));
    one.succeeded();
    assert.equal(one.failed(error("stalled")), 100);
  });

  it("knows what no retry mends, and what a few may", () => {
    assert.equal(new Backoff(options).failed(error("file-changed")), null);
    const missing = new Backoff(options, () => 1);
    assert.deepEqual(
      [0, 1, 2].map(() => missing.failed(error("http-status", 404))),
      [100, 200, null],
    );
    assert.equal(new Backoff(options, () => 1).failed(error("http-status", 503)), 100);
  });
});

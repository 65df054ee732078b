/** Words of packed splats, read back by the layout that Spark documents. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import type { TileValues } from "../src/decoder/types.js";
import { toHalf } from "../src/pack/half.js";
import { packSpark } from "../src/pack/spark.js";

function fromHalf(bits: number): number {
  const sign = bits & 0x8000 ? -1 : 1;
  const exponent = (bits >> 10) & 31;
  const fraction = bits & 1023;
  if (exponent === 31) return fraction === 0 ? sign * Infinity : NaN;
  return sign * (exponent === 0 ? fraction * 2 ** -24 : (1024 + fraction) * 2 ** (exponent - 25));
}

function signed(words: Uint32Array, splat: number, perSplat: number, bit: number, bits: number): number {
  let value = 0;
  for (let b = 0; b < bits; b++) {
    const at = bit + b;
    value |= ((words[splat * perSplat + (at >>> 5)] >>> (at & 31)) & 1) << b;
  }
  return value >= 2 ** (bits - 1) ? value - 2 ** bits : value;
}

/** (w, x, y, z) of the three bytes. */
function unpackRotation(u: number, v: number, angle: number): number[] {
  let x = (u / 255) * 2 - 1;
  let y = (v / 255) * 2 - 1;
  const z = 1 - Math.abs(x) - Math.abs(y);
  const fold = Math.max(-z, 0);
  x -= Math.sign(x) * fold;
  y -= Math.sign(y) * fold;
  const length = Math.hypot(x, y, z);
  const half = ((angle / 255) * Math.PI) / 2;
  return [Math.cos(half), ...[x, y, z].map((c) => (Math.sin(half) * c) / length)];
}

const COUNT = 300;

/** Numbers in [0, 1), the same each time. */
function* numbers(): Generator<number, never> {
  for (let state = 1; ;) {
    state = (Math.imul(state, 1103515245) + 12345) >>> 0;
    yield (state >>> 8) / 2 ** 24;
  }
}

function made(): TileValues {
  const next = numbers();
  const fill = (n: number, f: (x: number) => number) => Float32Array.from({ length: n }, () => f(next.next().value));
  const quats = fill(4 * COUNT, (x) => x - 0.5);
  for (let i = 0; i < COUNT; i++) {
    const row = quats.subarray(4 * i, 4 * i + 4);
    const length = Math.hypot(...row);
    row.forEach((c, j) => (row[j] = c / length));
  }
  return {
    tile: 5,
    layer: 2,
    count: COUNT,
    centres: fill(3 * COUNT, (x) => 20 * (x - 0.5)),
    scales: fill(3 * COUNT, (x) => Math.exp(8 * (x - 0.9))),
    quats,
    opacity: fill(COUNT, (x) => x),
    sh: fill(48 * COUNT, (x) => 2.4 * (x - 0.5)),
    shDegree: 3,
  };
}

const clamped = (x: number, most: number) => Math.min(Math.max(x, -most), most);

describe("packed splats", () => {
  const values = made();
  const packed = packSpark(values);

  it("hold colour, opacity, centre and scales", () => {
    for (let i = 0; i < COUNT; i++) {
      const [a, b, c, d] = packed.words.subarray(4 * i, 4 * i + 4);
      for (let j = 0; j < 3; j++) {
        const colour = Math.min(Math.max(0.5 + 0.28209479177387814 * values.sh[48 * i + j], 0), 1);
        assert.ok(Math.abs(((a >>> (8 * j)) & 255) / 255 - colour) <= 0.5 / 255 + 1e-6);
        const log = (((d >>> (8 * j)) & 255) - 1) * (21 / 254) - 12;
        assert.ok(Math.abs(log - Math.log(values.scales[3 * i + j])) <= 21 / 508 + 1e-5);
      }
      assert.ok(Math.abs((a >>> 24) / 255 - values.opacity[i]) <= 0.5 / 255 + 1e-6);
      [b & 0xffff, b >>> 16, c & 0xffff].forEach((half, j) => {
        const x = values.centres[3 * i + j];
        assert.ok(Math.abs(fromHalf(half) - x) <= Math.abs(x) * 2 ** -11 + 2 ** -25);
      });
    }
  });

  it("hold rotations up to their sign", () => {
    for (let i = 0; i < COUNT; i++) {
      const [, , c, d] = packed.words.subarray(4 * i, 4 * i + 4);
      const found = unpackRotation((c >>> 16) & 255, c >>> 24, d >>> 24);
      const dot = found.reduce((sum, x, j) => sum + x * values.quats[4 * i + j], 0);
      assert.ok(Math.abs(dot) > 0.9998, `rotation ${i}: ${dot}`);
    }
  });

  it("hold spherical harmonics of three degrees, clamped to -1..1", () => {
    const bands = [
      { words: packed.sh1!, per: 2, bits: 7, first: 3, n: 9 },
      { words: packed.sh2!, per: 4, bits: 8, first: 12, n: 15 },
      { words: packed.sh3!, per: 4, bits: 6, first: 27, n: 21 },
    ];
    for (const { words, per, bits, first, n } of bands) {
      const most = 2 ** (bits - 1) - 1;
      for (let i = 0; i < COUNT; i++) {
        for (let j = 0; j < n; j++) {
          const wanted = clamped(values.sh[48 * i + first + j], 1);
          assert.ok(Math.abs(signed(words, i, per, j * bits, bits) / most - wanted) <= 0.5 / most + 1e-6);
        }
      }
    }
  });

  it("have only the degrees of the scene", () => {
    const flat = packSpark({ ...values, sh: values.sh.slice(0, 3 * COUNT), shDegree: 0 });
    assert.deepEqual([flat.sh1, flat.sh2, flat.sh3], [null, null, null]);
    const one = packSpark({ ...values, sh: values.sh.slice(0, 12 * COUNT), shDegree: 1 });
    assert.equal(one.sh1!.length, 2 * COUNT);
    assert.equal(one.sh2, null);
  });

  it("know scales of 0 and beyond the range", () => {
    const scales = Float32Array.of(0, 1e-9, 1e9);
    const one = packSpark({ ...values, count: 1, scales });
    assert.equal(one.words[3] & 0xffffff, (255 << 16) | (1 << 8) | 0);
  });
});

describe("binary16", () => {
  it("comes back for every number that it has", () => {
    for (let bits = 0; bits < 0x7c00; bits++) {
      assert.equal(toHalf(fromHalf(bits)), bits);
      assert.equal(toHalf(-fromHalf(bits)), bits | 0x8000);
    }
  });

  it("is the nearest, ties to even", () => {
    assert.equal(toHalf(1 + 2 ** -11), 0x3c00);
    assert.equal(toHalf(1 + 3 * 2 ** -11), 0x3c02);
    assert.equal(toHalf(2 ** -25), 0);
    assert.equal(toHalf(3 * 2 ** -26), 1);
    assert.equal(toHalf(65519), 0x7bff);
    assert.equal(toHalf(65520), 0x7c00);
    assert.equal(fromHalf(toHalf(NaN)), NaN);
  });
});

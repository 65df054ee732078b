/** Words of textures, read back as the shaders of the adapters read them. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import type { TileValues } from "../src/decoder/types.js";
import { toHalf } from "../src/pack/half.js";
import { LN_SCALE_MIN, LN_SCALE_STEPS, OPACITY_STEPS, packWords } from "../src/pack/words.js";

const COUNT = 300;
const SH_0 = 0.28209479177387814;

function fromHalf(bits: number): number {
  const sign = bits & 0x8000 ? -1 : 1;
  const exponent = (bits >> 10) & 31;
  const fraction = bits & 1023;
  if (exponent === 31) return fraction === 0 ? sign * Infinity : NaN;
  return sign * (exponent === 0 ? fraction * 2 ** -24 : (1024 + fraction) * 2 ** (exponent - 25));
}

/** Numbers in [0, 1), the same each time. */
function* numbers(): Generator<number, never> {
  for (let state = 1; ;) {
    state = (Math.imul(state, 1103515245) + 12345) >>> 0;
    yield (state >>> 8) / 2 ** 24;
  }
}

function made(shDegree: number): TileValues {
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
    centres: fill(3 * COUNT, (x) => 2e5 * (x - 0.5)),
    scales: fill(3 * COUNT, (x) => Math.exp(20 * (x - 0.7))),
    quats,
    opacity: fill(COUNT, (x) => x),
    sh: fill(3 * (shDegree + 1) ** 2 * COUNT, (x) => 2.4 * (x - 0.5)),
    shDegree,
  };
}

/** Splat i of words: as `readScar` of adapters/spark.ts has it, quaternion w, x, y, z. */
function read(words: Uint32Array, i: number) {
  const w = words.subarray(8 * i, 8 * i + 8);
  const centre = [...new Float32Array(w.slice(0, 3).buffer)];
  const steps = [w[3] & 0xffff, w[3] >>> 16, w[4] & 0xffff];
  const kept = [(w[4] | 0) >> 16, (w[5] << 16) >> 16, (w[5] | 0) >> 16].map((k) => (k * Math.SQRT1_2) / 32767);
  const quat = [...kept];
  quat.splice((w[7] >>> 16) & 3, 0, Math.sqrt(1 - kept.reduce((sum, k) => sum + k * k, 0)));
  return {
    centre,
    scales: steps.map((s) => Math.exp(s / LN_SCALE_STEPS + LN_SCALE_MIN)),
    quat,
    colour: [w[6] & 0xffff, w[6] >>> 16, w[7] & 0xffff].map(fromHalf),
    opacity: (w[7] >>> 18) / OPACITY_STEPS,
  };
}

/** Coefficients above degree 0 of splat i. */
function harmonics(words: Uint32Array, degree: number, i: number): number[] {
  const own = words.slice(4 * degree * i, 4 * degree * (i + 1));
  const bytes = new Int8Array(own.buffer);
  const size = fromHalf(own[own.length - 1] >>> 16) / 127;
  return Array.from({ length: 3 * (degree + 1) ** 2 - 3 }, (_, k) => bytes[k] * size);
}

describe("packWords", () => {
  const values = made(3);
  const packed = packWords(values);
  const splats = Array.from({ length: COUNT }, (_, i) => read(packed.geometry, i));

  it("keeps what says which splats they are", () => {
    assert.deepEqual([packed.tile, packed.layer, packed.count, packed.shDegree], [5, 2, COUNT, 3]);
    assert.deepEqual([packed.geometry.length, packed.harmonics.length], [8 * COUNT, 12 * COUNT]);
  });

  it("keeps centres as they are", () => {
    splats.forEach(({ centre }, i) => assert.deepEqual(centre, [...values.centres.subarray(3 * i, 3 * i + 3)]));
  });

  it("rounds scales by a quarter of a thousandth", () => {
    splats.forEach(({ scales }, i) =>
      scales.forEach((s, k) => assert.ok(Math.abs(s / values.scales[3 * i + k] - 1) < 0.00025)),
    );
  });

  it("keeps rotations to four in a hundred thousand, whichever component is largest and whatever its sign", () => {
    const largest = new Set<number>();
    splats.forEach(({ quat }, i) => {
      const row = [...values.quats.subarray(4 * i, 4 * i + 4)];
      const sign = Math.sign(quat.reduce((sum, q, k) => sum + q * row[k], 0));
      quat.forEach((q, k) => assert.ok(Math.abs(sign * q - row[k]) < 4e-5, `${quat} for ${row}`));
      largest.add(row.findIndex((q) => Math.abs(q) === Math.max(...row.map(Math.abs))));
    });
    assert.equal(largest.size, 4);
  });

  it("keeps colours outside 0..1 and opacities", () => {
    splats.forEach(({ colour, opacity }, i) => {
      colour.forEach((c, k) => assert.ok(Math.abs(c - (0.5 + SH_0 * values.sh[48 * i + k])) < 5e-4));
      assert.ok(Math.abs(opacity - values.opacity[i]) <= 0.5001 / OPACITY_STEPS);
    });
    assert.ok(splats.some(({ colour }) => Math.min(...colour) < 0.2));
  });

  for (const degree of [1, 2, 3])
    it(`keeps harmonics of degree ${degree} to a two hundredth of the largest`, () => {
      const from = made(degree);
      const words = packWords(from).harmonics;
      const width = 3 * (degree + 1) ** 2;
      for (let i = 0; i < COUNT; i++) {
        const own = [...from.sh.subarray(width * i + 3, width * (i + 1))];
        const peak = Math.max(...own.map(Math.abs));
        harmonics(words, degree, i).forEach((x, k) => assert.ok(Math.abs(x - own[k]) < peak / 200));
      }
    });

  it("draws nothing where nothing is drawn, and stands extremes", () => {
    const extreme: TileValues = {
      ...made(1),
      count: 2,
      scales: Float32Array.of(0, 1e30, 1e-30, 1, 1, 1),
      quats: Float32Array.of(0, 0, 0, 0, -1, 0, 0, 0),
      opacity: Float32Array.of(0, 1),
      sh: new Float32Array(24).fill(3e38),
    };
    const { geometry } = packWords(extreme);
    const [nothing, whole] = [read(geometry, 0), read(geometry, 1)];
    assert.equal(nothing.opacity, 0);
    assert.equal(whole.opacity, 1);
    assert.deepEqual(whole.quat.map(Math.abs), [1, 0, 0, 0]);
    assert.deepEqual(whole.colour, [65504, 65504, 65504]);
    assert.ok([...nothing.scales, ...nothing.quat].every(Number.isFinite));
  });
});

describe("toHalf", () => {
  it("gives back each binary16, and rounds between two to the even one", () => {
    for (let bits = 0; bits < 0x7c00; bits++) {
      assert.equal(toHalf(fromHalf(bits)), bits);
      assert.equal(toHalf(-fromHalf(bits)), bits | 0x8000);
    }
    assert.equal(toHalf((fromHalf(0x3c00) + fromHalf(0x3c01)) / 2), 0x3c00);
    assert.equal(toHalf((fromHalf(0x3c01) + fromHalf(0x3c02)) / 2), 0x3c02);
    assert.equal(toHalf(2 ** -25), 0);
  });
});

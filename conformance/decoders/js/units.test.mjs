/** Tests of the parts of the decoder, and of damaged files: `node --test units.test.mjs`. */

import assert from "node:assert/strict";
import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { describe, it } from "node:test";
import { fileURLToPath } from "node:url";

import { answer } from "./answers.js";
import { littleEndian } from "./arrays.js";
import { Reader } from "./bytes.js";
import { crc32 } from "./crc32.js";
import { openScar, Refused } from "./decoder.js";
import { parseMetadata } from "./metadata.js";
import { exp2w, sigmoid12, tanh12 } from "./integers.js";
import { makeVectors } from "./network_block.js";
import { repack, varint as packedVarint } from "./packing.mjs";
import { RansStream } from "./rans.js";
import { readRice, readShifted } from "./rice.js";
import { Sha256 } from "./sha256.js";
import { memorySource } from "./source.js";
import { cumulativeFrequencies, Table, uniformTable } from "./tables.js";

const VECTORS = join(dirname(fileURLToPath(import.meta.url)), "../../vectors");
const WORKED = join(VECTORS, "worked");

/** @param {number} seed @returns {(n: number) => number} numbers below n, the same ones every time */
function random(seed) {
  let state = seed;
  return (n) => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return Math.floor((state / 2 ** 32) * n);
  };
}

/** @param {() => unknown} action @param {string} id */
function refuses(action, id) {
  assert.throws(action, (error) => error instanceof Refused && error.id === id);
}

function ask(bytes) {
  return JSON.parse([...answer(memorySource(bytes), { layers: 0, stage: "all" })].join(""));
}

describe("checksums", () => {
  it("CRC-32 is that of SPEC §1, also in parts", () => {
    const digits = new TextEncoder().encode("123456789");
    assert.equal(crc32(digits), 0xcbf43926);
    assert.equal(crc32(digits.subarray(4), crc32(digits.subarray(0, 4))), 0xcbf43926);
  });

  it("SHA-256 agrees with that of Node whatever the parts", () => {
    const next = random(1);
    for (const n of [0, 1, 55, 56, 63, 64, 65, 119, 120, 4097]) {
      const bytes = Uint8Array.from({ length: n }, () => next(256));
      const sha = new Sha256();
      for (let at = 0; at < n; at += 37) sha.update(bytes.subarray(at, at + 37));
      assert.equal(sha.hex(), createHash("sha256").update(bytes).digest("hex"));
    }
  });
});

describe("fields", () => {
  const varint = (bits, ...bytes) => new Reader(Uint8Array.from(bytes)).varint(bits);

  it("varints take values up to their bits, in as few bytes as may be", () => {
    assert.equal(varint(16, 0xff, 0xff, 0x03), 65535);
    assert.equal(varint(32, 0xff, 0xff, 0xff, 0xff, 0x0f), 2 ** 32 - 1);
    refuses(() => varint(16, 0x80, 0x80, 0x04), "bad-varint");
    refuses(() => varint(16, 0x80, 0x00), "bad-varint");
    refuses(() => varint(16, 0x80, 0x80, 0x80), "bad-varint");
    refuses(() => varint(16, 0x80, 0x80), "payload-short");
  });

  it("a count of nearly 2^63 is above its limit and no bad varint", () => {
    const most = [0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f];
    refuses(() => new Reader(Uint8Array.from(most)).count(65536), "count-limit");
    refuses(() => new Reader(Uint8Array.of(...most.slice(0, 8), 0xff, 0x01)).count(65536), "bad-varint");
  });

  it("large varints are exact", () => {
    for (const value of [0n, 127n, 2n ** 53n - 1n, 2n ** 53n + 1n, 2n ** 62n + 3n, 2n ** 63n - 1n]) {
      assert.equal(new Reader(Uint8Array.from(packedVarint(value))).bigVarint(63), value);
    }
    refuses(() => new Reader(Uint8Array.from(packedVarint(2n ** 63n))).bigVarint(63), "bad-varint");
  });

  it("Rice codes are those of the note of §5.9", () => {
    const reader = new Reader(Uint8Array.of(0x01, 0x3a, 0x50));
    assert.deepEqual([...readRice(reader, 4)], [0, -1, 3, -2]);
    reader.end();
  });

  it("a Rice code can hold -2^31, which is too much once shifted", () => {
    // k = 31: one quotient of 1, low bits all 1, m = 2^32 - 1.
    const bytes = [31, 0b10000000, 0xff, 0xff, 0xff, 0xfe];
    assert.deepEqual([...readRice(new Reader(Uint8Array.from(bytes)), 1)], [-(2 ** 31)]);
    refuses(() => readShifted(new Reader(Uint8Array.of(0, ...bytes)), 1), "bad-rice");
  });

  it("a cut Rice code is short even where a quotient is too large", () => {
    refuses(() => readRice(new Reader(new Uint8Array(40).fill(0xff, 1)), 2), "payload-short");
    refuses(() => readRice(new Reader(new Uint8Array(70).fill(0xff, 1)), 2), "bad-rice");
  });
});

describe("rANS", () => {
  /** Encodes symbols of tables as §8.2 says, with BigInt. */
  function encode(pairs) {
    let state = 0n;
    const words = [];
    for (const [{ cumulative, size }, symbol] of [...pairs].reverse()) {
      if (size === 1) continue;
      const start = BigInt(cumulative[symbol]);
      const frequency = BigInt(cumulative[symbol + 1]) - start;
      if (state >> 40n >= frequency) {
        words.push(Number(state & 0xffffffffn));
        state >>= 32n;
      }
      state = ((state / frequency) << 24n) + start + (state % frequency);
    }
    for (; state > 0n; state >>= 32n) words.push(Number(state & 0xffffffffn));
    return new Uint8Array(Uint32Array.from(words).buffer);
  }

  it("decodes what the encoder of §8.2 writes, with tables of every shape", () => {
    const next = random(2);
    for (let round = 0; round < 60; round++) {
      const tables = Array.from({ length: 4 }, () => {
        const size = 1 + next(round % 3 === 0 ? 4096 : 12);
        const top = 2 ** (1 + next(23));
        return new Table(null, cumulativeFrequencies(Array.from({ length: size }, () => 1 + next(top))));
      });
      tables.push(uniformTable(4096), new Table(null, cumulativeFrequencies([2 ** 24 - 1, 1])));
      const runs = Array.from({ length: 20 }, () => {
        const table = tables[next(tables.length)];
        return { table, symbols: Array.from({ length: next(90) }, () => next(table.size)) };
      });
      const bytes = encode(runs.flatMap(({ table, symbols }) => symbols.map((symbol) => [table, symbol])));
      const stream = new RansStream(bytes);
      for (const { table, symbols } of runs) {
        const out = new Int32Array(symbols.length);
        stream.read(table, symbols.length, out);
        assert.deepEqual([...out], symbols);
      }
      stream.seal();
    }
  });

  it("one step at a time is the same as many", () => {
    const table = new Table(null, cumulativeFrequencies([5, 1, 700, 3]));
    const next = random(3);
    const bytes = encode(Array.from({ length: 500 }, () => [table, next(4)]));
    const many = new RansStream(bytes);
    const single = new RansStream(bytes);
    const out = new Int32Array(1);
    for (let i = 0; i < 500; i++) {
      many.read(table, 1, out);
      const [start, past] = [table.cumulative[out[0]], table.cumulative[out[0] + 1]];
      assert.ok(start <= single.slot && single.slot < past);
      single.advance(start, past - start);
    }
    single.seal();
    many.seal();
  });

  it("cumulative frequencies are exact beyond 2^53", () => {
    const weights = Array.from({ length: 4096 }, (_, i) => 2 ** 24 - 1 - i);
    const sum = weights.reduce((a, b) => a + BigInt(b), 0n);
    let before = 0n;
    const cumulative = cumulativeFrequencies(weights);
    weights.forEach((weight, i) => {
      assert.equal(BigInt(cumulative[i]), (before * (2n ** 24n - 4096n)) / sum + BigInt(i));
      before += BigInt(weight);
    });
    assert.equal(cumulative[4096], 2 ** 24);
  });

  it("streams keep R-8.2-1 and R-8.2-2", () => {
    refuses(() => new RansStream(new Uint8Array(5)), "rans-length");
    refuses(() => new RansStream(new Uint8Array(4)), "rans-last-word");
    refuses(() => new RansStream(Uint8Array.of(0, 0, 0, 1)).seal(), "rans-seal");
    new RansStream(new Uint8Array(0)).seal();
  });
});

describe("integer networks", () => {
  it("functions are odd, or mirrored, and end where the tables end", () => {
    for (const u of [0, 1, 31, 255, 256, 2 ** 24]) {
      assert.equal(tanh12(-u) + tanh12(u), 0);
      assert.equal(sigmoid12(-u) + sigmoid12(u), 4096);
    }
    assert.deepEqual([exp2w(0), exp2w(1), exp2w(32), exp2w(511), exp2w(512)], [65536, 64132, 32768, 1, 0]);
  });

  it("codewords as activations are those of appendix C", () => {
    const words = Int32Array.of(1, -1, 24, 3, 19, -9, 30, -2);
    const biases = Int32Array.of(0, 15, -25, 40);
    const clusterBiases = Int32Array.of(120, -60);
    const head = { size: 4, clusters: [1, 3], shift: 3, memberShift: 1, clusterBiases, biases };
    const net = { activationBits: 8, codewordDims: 2, codewordShift: 1, heads: [head] };
    const { e, centroids, deviations } = makeVectors(net, 0, { number: 0, size: 4, dims: 2, words });
    assert.deepEqual([...e], [1, 0, 8, 12, 2, 64, 10, -4, 56, 15, -1, 64]);
    assert.deepEqual([...centroids], [1, 0, 8, 12, -1, 61]);
    assert.deepEqual([...deviations], [0, 0, 0, 0, 3, 3, -2, -3, -5, 3, 0, 3]);
  });
});

describe("arrays of an answer", () => {
  it("have their least significant bytes first on every machine", () => {
    const numbers = new Uint32Array([0x01020304, 5]);
    const bytes = new DataView(new ArrayBuffer(8));
    bytes.setUint32(0, numbers[0], true);
    bytes.setUint32(4, numbers[1], true);
    assert.deepEqual([...littleEndian(numbers)], [...new Uint8Array(bytes.buffer)]);
    const there = new Float64Array(new Uint8Array(new Float64Array([0.1, -3]).buffer).slice().buffer);
    const swapped = littleEndian(there, true);
    assert.deepEqual([...swapped.subarray(0, 8)], [...new Uint8Array(there.buffer, 0, 8)].reverse());
    assert.deepEqual([...littleEndian(new Uint8Array([1, 2]), true)], [1, 2]);
    assert.deepEqual([...new Float64Array(there)], [0.1, -3]);
  });
});

describe("metadata", () => {
  const read = (/** @type {string} */ text) => parseMetadata(new TextEncoder().encode(text));

  it("is read with brackets in strings and 64 deep, and refused one level deeper", () => {
    const deep = (/** @type {number} */ n) => `{"a[":${"[".repeat(n - 1)}"\\"[{"${"]".repeat(n - 1)}}`;
    assert.deepEqual(Object.keys(read(deep(64)).value), ["a["]);
    refuses(() => read(deep(65)), "limit-metadata");
    refuses(() => read("[".repeat(200000)), "limit-metadata");
  });

  it("is refused for what JSON.parse drops or keeps in silence", () => {
    for (const value of ['"\\ud800"', '"\\udf0d\\ud83c"', "1e309", "9".repeat(400)]) {
      for (const text of [`{"a":${value}}`, `{"a":${value},"a":0}`, `{"b":[[${value}]]}`]) {
        refuses(() => read(text), "bad-metadata");
      }
    }
    refuses(() => read('{"\\udfff":0}'), "bad-metadata");
    assert.deepEqual(read('{"a":"\\ud83c\\udf0d\\\\ud800"}').value, { a: "\u{1f30d}\\ud800" });
  });
});

describe("interface", () => {
  const bytes = new Uint8Array(readFileSync(join(WORKED, "input.scar")));

  it("decodes the worked file to the values of appendix B", () => {
    const scar = openScar(bytes);
    const first = scar.decode({ layers: 1 });
    assert.deepEqual([...first.position], [1.875, 0.875, 4.375, 2.625, 1.875, 4.625]);
    const all = scar.decode({ activated: true });
    assert.equal(all.anchors, 3);
    assert.deepEqual([...all.class], [0, 0, 1]);
    assert.deepEqual([...all.values.OPACITY], [-0.25, -0.25, -1]);
    assert.equal(all.activated.sh.length, 9);
    assert.equal(scar.metadata(), null);
  });

  it("decodes the layers of a cut file that arrived whole, if asked to", () => {
    const [first] = openScar(bytes).container.layers;
    const cut = bytes.subarray(0, first.end_offset + 5);
    refuses(() => openScar(cut), "truncated-file");
    const scar = openScar(cut, { allowTruncated: true });
    assert.equal(scar.layersArrived, 1);
    assert.equal(scar.decode({ layers: 1 }).anchors, 2);
    refuses(() => scar.decode(), "truncated-block");
    refuses(() => openScar(bytes.subarray(0, first.end_offset - first.byte_count - 1), { allowTruncated: true }), "truncated-directory");
  });

  it("limits can be lowered", () => {
    refuses(() => openScar(bytes, { limits: { anchors: 2 } }), "limit-anchors");
    refuses(() => openScar(bytes, { limits: { root_bytes: 10 } }), "limit-root");
  });

  it("a scene is not gathered beyond what is allowed, its first layer and its tiles may be", () => {
    for (const limits of [{ gathered: 2 }, { gathered_slots: 2 }]) {
      const scar = openScar(bytes, { limits });
      refuses(() => scar.decode(), "limit-gathered");
      assert.equal(scar.decode({ layers: 1 }).anchors, 2);
      assert.equal(scar.decode({ tiles: [] }).anchors, 0);
      assert.equal([...scar.tiles()][0].size, 3);
    }
  });
});

/** Changes bytes of blocks, and makes checksums right again, so that what is behind them is looked at. */
function damageBlocks({ source, entries }, times, next) {
  for (let i = 0; i < times; i++) {
    const e = next(entries.kind.length);
    const block = source.read(entries.offset[e], entries.length[e]);
    block[next(block.length)] = next(256);
    if (entries.kind[e] === 16) repairTile(block);
    entries.crc32[e] = crc32(block);
  }
}

/** Makes the CRCs of sub-streams right again, as far as their table can be read. */
function repairTile(block) {
  const view = new DataView(block.buffer, block.byteOffset, block.byteLength);
  const table = 1 + 9 * block[0];
  if (table + 4 > block.length) return;
  for (let at = 1, from = table + 4; at < table; at += 9) {
    const past = from + view.getUint32(at + 1, true);
    if (past <= block.length) view.setUint32(at + 5, crc32(block.subarray(from, past)), true);
    from = past;
  }
  view.setUint32(table, crc32(block.subarray(0, table)), true);
}

/** Changes a number of the directory. */
function damageDirectory({ root, tiles, rows }, next) {
  const lists = [...tiles.flatMap(({ depth, shift, gap }) => [depth, shift, gap])];
  lists.push(...rows.flat().flatMap(({ length, count }) => [length, count]), ...root.models);
  const list = lists.filter(({ length }) => length > 0)[next(lists.filter(({ length }) => length > 0).length)];
  const i = next(list.length);
  if (typeof list[i] === "object") list[i].count = next(256);
  else list[i] = typeof list[i] === "bigint" ? BigInt(next(8)) : next(256);
}

describe("damage", () => {
  it("of any kind ends in an answer", () => {
    const next = random(4);
    const folders = ["worked", "valid/anchors", "valid/index-grid", "valid/annotations", "valid/predictors"];
    const files = folders.map((name) => readFileSync(join(VECTORS, name, "input.scar")));
    for (let round = 0; round < 600; round++) {
      let bytes = new Uint8Array(files[round % files.length]);
      if (next(8) === 0) {
        for (let i = 1 + next(3); i > 0; i--) bytes[next(bytes.length)] = next(256);
      } else {
        const { container } = openScar(bytes);
        damageBlocks(container, 1 + next(3), next);
        const change = (directory) => next(4) === 0 && damageDirectory(directory, next);
        bytes = repack(container, { pageBits: next(3), change });
      }
      const found = ask(bytes);
      assert.ok(typeof found.refused === "string" || typeof found.stages === "object");
    }
  });
});

/** What the front of a file tells: places, boxes, sizes, with as few requests as it takes. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { openScar } from "../../conformance/decoders/js/decoder.js";
import { frontLength, parseFront } from "../src/stream/front.js";
import { FIRST_BYTES, openFront } from "../src/stream/open_front.js";
import type { ByteSource } from "../src/stream/source.js";
import { wantedEntries } from "../src/stream/wanted.js";
import { toys, vector } from "./files.js";

const bytes = toys();

/** Bytes in chunks of some size. */
function sourceOf(file: Uint8Array, chunk: number, ranged = true): ByteSource & { asked: [number, number][] } {
  const asked: [number, number][] = [];
  return {
    name: "bytes",
    size: ranged ? file.length : null,
    ranged,
    asked,
    async open(offset, length) {
      asked.push([offset, length]);
      const [start, end] = ranged ? [offset, offset + length] : [0, file.length];
      async function* chunks() {
        for (let at = start; at < end; at += chunk) yield file.subarray(at, Math.min(at + chunk, end));
      }
      return { offset: start, chunks: chunks() };
    },
  };
}

describe("the front", () => {
  it("gives places and final counts of all tiles", () => {
    const front = parseFront(bytes, bytes.length);
    const sizes = [...openScar(bytes).tiles()].map(({ size }) => size);
    assert.deepEqual([...front.finalCounts], sizes);
    assert.deepEqual(
      [...front.base],
      sizes.map((_, t) => sizes.slice(0, t).reduce((a, b) => a + b, 0)),
    );
    assert.equal(front.total, 10914);
  });

  it("counts slots in the anchor profile", () => {
    const file = vector("valid/anchors");
    const front = parseFront(file, file.length);
    const scar = openScar(file);
    const places = [...scar.tiles()].map(({ size }) => size * scar.header.slots);
    assert.deepEqual([...front.finalCounts], places);
  });

  it("gives boxes that hold every anchor of their tile", () => {
    const { index } = parseFront(bytes, bytes.length);
    const scar = openScar(bytes);
    const slack = scar.header.voxel;
    for (const tile of scar.tiles()) {
      const { position } = scar.exactValues(tile);
      const box = index.boxes.subarray(6 * tile.number, 6 * tile.number + 6);
      position.forEach((x, i) => assert.ok(x >= box[i % 3] - slack && x <= box[3 + (i % 3)] + slack));
    }
  });

  it("gives sizes that add up to the layers'", () => {
    const { index, layers } = parseFront(bytes, bytes.length);
    layers.forEach(({ stream_bytes, byte_count, anchor_count }, k) => {
      const of = (array: ArrayLike<number>) =>
        Array.from({ length: index.tiles }, (_, t) => array[t * index.layers + k]).reduce((a, b) => a + b, 0);
      const before = k === 0 ? 0 : layers[k - 1].anchor_count;
      assert.equal(of(index.counts), anchor_count - before);
      assert.equal(of(index.bytes), byte_count - stream_bytes[0]);
    });
  });

  it("is one request where it is short, two where it is long, whatever the chunks", async () => {
    const length = frontLength(bytes, bytes.length);
    for (const chunk of [1000, 64 * 1024]) {
      const source = sourceOf(bytes, chunk);
      const opened = await openFront(source, new AbortController().signal);
      assert.deepEqual(source.asked, [[0, FIRST_BYTES]]);
      assert.deepEqual(opened.bytes, bytes.subarray(0, length));
      assert.deepEqual(opened.rest, bytes.subarray(length, opened.read));
    }
    const source = sourceOf(bytes, 1000);
    const opened = await openFront(source, new AbortController().signal, 3000);
    assert.deepEqual(source.asked, [
      [0, 3000],
      [3000, length - 3000],
    ]);
    assert.deepEqual([opened.bytes, opened.rest.length, opened.end], [bytes.slice(0, length), 0, length]);
  });

  it("is read on where there are no ranges", async () => {
    const source = sourceOf(bytes, 5000, false);
    const opened = await openFront(source, new AbortController().signal);
    assert.equal(opened.end, bytes.length);
    assert.equal(source.asked.length, 1);
  });
});

describe("what to fetch", () => {
  const front = parseFront(bytes, bytes.length);
  const kinds = (list: number[]) =>
    list.map((e) => [front.entries.kind[e], front.entries.layer[e], front.entries.tile[e]]);

  it("has the models of a layer before its first tile, each once", () => {
    const list = wantedEntries(
      front,
      [
        { tile: 3, layer: 1 },
        { tile: 3, layer: 2 },
        { tile: 4, layer: 1 },
      ],
      -1,
    );
    assert.equal(new Set(list).size, list.length);
    const tiles = kinds(list).filter(([kind]) => kind === 16);
    assert.deepEqual(tiles, [
      [16, 1, 3],
      [16, 2, 3],
      [16, 1, 4],
    ]);
    const last = (layer: number) => kinds(list).findLastIndex(([kind, l]) => kind < 16 && l === layer);
    assert.ok(last(1) < list.indexOf(front.tileEntries[3 * 5]));
    assert.ok(last(2) < list.indexOf(front.tileEntries[3 * 5 + 1]));
  });

  it("has models of the layers before, and an annotation after the first models", () => {
    const annotation = front.entries.kind.indexOf(64);
    const list = wantedEntries(front, [{ tile: 0, layer: 3 }], annotation);
    assert.deepEqual(list.slice(0, front.modelEntries[0].length), front.modelEntries[0]);
    assert.equal(list[front.modelEntries[0].length], annotation);
    for (const k of [0, 1, 2]) for (const e of front.modelEntries[k]) assert.ok(list.includes(e));
  });
});

/** What the front of a file tells: places, boxes, sizes, with as few requests as it takes. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { type Directory, frontLength, openPages, parseFront } from "../src/format/directory.js";
import { FRONT_SIZES, openFront } from "../src/stream/open_front.js";
import type { ByteSource } from "../src/stream/source.js";
import { wantedEntries } from "../src/stream/wanted.js";
import { Feeder } from "./feeding.js";
import { openedFront, toys, vector, WholeFile } from "./files.js";

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

/** Anchors of each tile, all layers together. */
function anchors({ index: { tiles, layers, counts } }: Directory): number[] {
  const of = (tile: number) => counts.subarray(tile * layers, (tile + 1) * layers).reduce((a, b) => a + b, 0);
  return Array.from({ length: tiles }, (_, tile) => of(tile));
}

/** Bytes of the directory. */
const directoryBytes = (file: Uint8Array) => new WholeFile(file).blocks[0].offset;

describe("the front", () => {
  it("gives what there is of all tiles, and slots in the anchor profile", () => {
    for (const file of [bytes, vector("valid/anchors")]) {
      const front = openedFront(file);
      const feeder = new Feeder(file);
      feeder.decodeTo(feeder.layers);
      const { slots } = front.header;
      const sizes = Array.from({ length: feeder.tiles }, (_, tile) => feeder.decoder.values(tile).count / slots);
      assert.deepEqual(anchors(front), sizes);
      assert.equal(front.total, sizes.reduce((a, b) => a + b, 0) * slots);
    }
  });

  it("gives boxes that hold every anchor of their tile", () => {
    const { index, header } = openedFront(bytes);
    const feeder = new Feeder(bytes);
    feeder.decodeTo(feeder.layers);
    const slack = header.voxel;
    for (let tile = 0; tile < feeder.tiles; tile++) {
      const box = index.boxes.subarray(6 * tile, 6 * tile + 6);
      feeder.decoder.values(tile).centres.forEach((x, i) => assert.ok(x >= box[i % 3] - slack && x <= box[3 + (i % 3)] + slack));
    }
  });

  it("gives sizes that add up to the layers', before and after pages are read", () => {
    for (const { index, layers } of [parseFront(bytes, bytes.length), openedFront(bytes)]) {
      layers.forEach(({ stream_bytes, byte_count, anchor_count }, k) => {
        const of = (array: ArrayLike<number>) =>
          Array.from({ length: index.tiles }, (_, t) => array[t * index.layers + k]).reduce((a, b) => a + b, 0);
        const appear = anchor_count - (k === 0 ? 0 : layers[k - 1].anchor_count);
        assert.ok(of(index.counts) >= appear && of(index.counts) < appear + index.tiles, "up to one a tile more");
        assert.ok(Math.abs(of(index.bytes) - (byte_count - stream_bytes[0])) < 1e-6);
      });
    }
  });

  it("gives boxes of pages that hold those of their tiles", () => {
    const coarse = parseFront(bytes, bytes.length).index.boxes;
    const fine = openedFront(bytes).index.boxes;
    fine.forEach((x, i) => assert.ok(i % 6 < 3 ? coarse[i] <= x : coarse[i] >= x));
  });

  it("is one request where it is short, two where it is long, whatever the chunks", async () => {
    const length = frontLength(bytes, bytes.length);
    const end = directoryBytes(bytes);
    for (const chunk of [1000, 64 * 1024]) {
      const source = sourceOf(bytes, chunk);
      const opened = await openFront(source, new AbortController().signal);
      assert.deepEqual(source.asked, [[0, FRONT_SIZES.firstBytes]]);
      assert.deepEqual(opened.bytes, bytes.subarray(0, length));
      assert.deepEqual([opened.position, opened.rest], [end, bytes.subarray(end, opened.read)]);
    }
    const source = sourceOf(bytes, 500);
    const opened = await openFront(source, new AbortController().signal, { ...FRONT_SIZES, firstBytes: end - 100 });
    const { offset } = opened.front.entries;
    const layer1 = offset[2 * opened.front.root.pages];
    assert.deepEqual(source.asked, [[0, end - 100]]);
    assert.deepEqual([opened.position, opened.end], [layer1, end - 100]);
  });

  it("is read on where there are no ranges, with all pages", async () => {
    const source = sourceOf(bytes, 5000, false);
    const opened = await openFront(source, new AbortController().signal);
    assert.deepEqual([opened.end, opened.position], [bytes.length, directoryBytes(bytes)]);
    assert.equal(source.asked.length, 1);
  });
});

describe("what to fetch", () => {
  const front = openedFront(bytes);
  const { numbers } = front;

  it("has the models of a layer before its first tile, each once", () => {
    const steps = [
      { tile: 3, layer: 1 },
      { tile: 3, layer: 2 },
      { tile: 4, layer: 1 },
    ];
    const list = wantedEntries(front, steps, -1);
    assert.equal(new Set(list).size, list.length);
    const tiles = list.map((e) => numbers.partOf(e)).filter(({ what }) => what === "tile");
    assert.deepEqual(tiles, steps.map((step) => ({ what: "tile", ...step })));
    for (const layer of [1, 2]) {
      const place = list.indexOf(numbers.tileBlock(3, layer));
      assert.ok(numbers.models(layer).every((e) => list.indexOf(e) >= 0 && list.indexOf(e) < place));
    }
  });

  it("has models of the layers before, and a block of no tile after the first models", () => {
    const other = numbers.blockOfFirst(64);
    const list = wantedEntries(front, [{ tile: 0, layer: 3 }], other);
    const first = numbers.models(1);
    assert.deepEqual(list.slice(0, first.length), first);
    assert.equal(list[first.length], other);
    for (const k of [1, 2, 3]) for (const e of numbers.models(k)) assert.ok(list.includes(e));
  });

  it("has pages in place of blocks that nothing is known of, each once", () => {
    const closed = parseFront(bytes, bytes.length);
    const steps = [2, 3, 0].map((tile) => ({ tile, layer: 2 }));
    const pages = (list: number[]) => list.map((e) => closed.numbers.partOf(e)).filter(({ what }) => what !== "block");
    assert.deepEqual(pages(wantedEntries(closed, steps, -1)), [
      { what: "tiles", page: 1 },
      { what: "rows", page: 1, layer: 2 },
      { what: "tiles", page: 0 },
      { what: "rows", page: 0, layer: 2 },
    ]);
    openPages(closed, bytes.subarray(0, closed.entries.offset[closed.root.pages]));
    assert.deepEqual(pages(wantedEntries(closed, steps, -1)), [
      { what: "rows", page: 1, layer: 2 },
      { what: "rows", page: 0, layer: 2 },
    ]);
  });
});

/** Header, ROOT and pages: the same tiles and blocks in pages of any size, each rule in its place. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { crc32 } from "../src/format/crc32.js";
import { type Header, MOST_HEADER } from "../src/format/header.js";
import { readTilePage } from "../src/format/pages.js";
import { Reader } from "../src/format/reader.js";
import type { Root } from "../src/format/root.js";
import { parseStreaming } from "../src/format/streaming.js";
import { openedFront, vector, WholeFile } from "./files.js";
import { type PackedDirectory, type PackedRoot, packedTiles, repack } from "./packing.js";

const file = new WholeFile(vector("valid/index-grid"));
const { header } = file.front;

function refuses(action: () => unknown, id: string): void {
  assert.throws(action, { name: "Refused", id });
}

/** A file whose header was changed, checksum and all. */
function withHeader(change: (view: DataView) => void): Uint8Array {
  const bytes = file.bytes.slice();
  const view = new DataView(bytes.buffer);
  change(view);
  const end = header.header_length - 4;
  view.setUint32(end, crc32(bytes.subarray(0, end)), true);
  return bytes;
}

describe("numbers", () => {
  it("are read as SPEC §5.7 says, and refused where they are not the shortest or too large", () => {
    const varint = (...bytes: number[]) => new Reader(Uint8Array.from(bytes)).varint(32);
    assert.deepEqual([varint(0), varint(0x7f), varint(0x80, 1)], [0, 127, 128]);
    assert.equal(varint(0xff, 0xff, 0xff, 0xff, 0x0f), 2 ** 32 - 1);
    refuses(() => varint(0x80, 0), "bad-varint");
    refuses(() => varint(0xff, 0xff, 0xff, 0xff, 0x10), "bad-varint");
    refuses(() => varint(0x80), "payload-short");
    const large = Uint8Array.from([...Array(8).fill(0xff), 0x7f]);
    assert.equal(new Reader(large).bigVarint(63), 2n ** 63n - 1n);
  });

  it("of a checksum are those of zlib", () => {
    assert.equal(crc32(new TextEncoder().encode("123456789")), 0xcbf43926);
    assert.equal(crc32(new Uint8Array(0)), 0);
  });
});

describe("pages", () => {
  it("of any size give the same tiles and the same blocks", () => {
    assert.ok(header.tile_count >= 3 && header.layer_count >= 2, "there is something to cut");
    for (const pageBits of [0, 1, 2, 16]) {
      const other = new WholeFile(repack(file, { pageBits }));
      assert.equal(other.front.header.page_bits, pageBits);
      assert.deepEqual(other.cubes, file.cubes);
      const placed = other.blocks.map((block, i) => ({ ...block, offset: file.blocks[i].offset }));
      assert.deepEqual(placed, file.blocks);
      other.blocks.forEach((block, i) => assert.deepEqual(other.body(block), file.body(file.blocks[i])));
    }
  });

  /** What is read of a tile page that begins at `base`, before another one that begins at `end`. */
  function read(depth: number[], gap: bigint[], base: bigint, end: bigint | null = null) {
    const page = packedTiles({ depth, shift: depth.map(() => 0), gap });
    const tilePages = { offset: [0], length: [page.length], crc32: [crc32(page)] };
    const root = { pages: end === null ? 1 : 2, base: [base, end], tilePages } as unknown as Root;
    const own: Header = { ...header, page_bits: 2, tile_count: depth.length, lattice_bits: 21 };
    return [...readTilePage(page, own, root, 0).prefix];
  }

  it("hold cubes up to the last one, which ends at 2^63", () => {
    const prefix = [0n, 2n ** 62n + 1n, 2n ** 63n - 2n, 2n ** 63n - 1n];
    const gaps = prefix.map((code, i) => (i === 0 ? code : code - prefix[i - 1] - 1n));
    assert.deepEqual(read([21, 21, 21, 21], gaps, 0n), prefix);
    refuses(() => read([21, 21, 21, 21], [...gaps.slice(0, 3), 1n], 0n), "tile-prefix");
  });

  it("begin where ROOT says, and end before the next one begins", () => {
    assert.deepEqual(read([20, 21], [0n, 3n], 8n, 20n), [1n, 19n]);
    refuses(() => read([20, 21], [0n, 3n], 8n, 19n), "tile-order");
    refuses(() => read([20, 21], [0n, 3n], 9n), "tile-order");
    refuses(() => read([20, 21], [1n, 3n], 8n), "tile-order");
  });
});

/** Refusals in the order of their rules; a file with two faults has the first of them. */
const ROOT_FAULTS: [string, (root: PackedRoot) => void][] = [
  ["entry-kind", ({ models }) => (models[0][0].kind = 16)],
  ["entry-flags", ({ models }) => (models[1][0].flags = 2)],
  ["entry-layer", ({ models }) => models[1].push({ ...models[0][0], kind: 64, flags: 2 })],
  ["entry-order", ({ models }) => models[1].push({ ...models[1][0] })],
  ["entry-length", ({ models }) => (models[0][0].length = 0)],
  ["entry-count", ({ models }) => models[0].push({ kind: 64, flags: 2, length: 1, count: 1, crc32: 0 })],
  ["tile-order", ({ pages }) => (pages[1].gap = 0n)],
  ["page-length", ({ pages }) => (pages[0].tile_bytes = 23)],
  ["page-sums", ({ pages }) => (pages[0].rows[0].block_bytes = 0)],
  ["layer-directory-bytes", ({ pages }) => pages[0].rows[0].block_bytes++],
  ["layer-directory-anchors", ({ pages }) => pages[0].rows[0].anchors++],
  ["directory-length", ({ pages }) => pages[0].tile_bytes++],
];

const PAGE_FAULTS: [string, (directory: PackedDirectory) => void][] = [
  ["payload-short", ({ tiles: [page] }) => [page.shift.pop(), (page.gap[1] = 2n ** 14n)]],
  ["payload-long", ({ tiles: [page] }) => page.gap.push(0n)],
  ["tile-depth", ({ tiles: [{ depth }] }) => (depth[0] = 22)],
  ["tile-shift", ({ tiles: [{ shift }] }) => (shift[0] = 32)],
  ["tile-local-bits", ({ tiles: [{ shift }] }) => (shift[0] = 31)],
  ["tile-prefix", ({ tiles: [{ gap }] }) => (gap[1] = 2n ** 62n)],
  ["tile-order", ({ tiles: [{ gap }] }) => gap[0]++],
  ["payload-short", ({ rows: [[page]] }) => page.crc32.pop()],
  ["payload-long", ({ rows: [[page]] }) => page.crc32.push(0)],
  ["page-sums", ({ rows: [[page]] }) => page.count[0]++],
  ["page-sums", ({ rows: [, [page]] }) => page.length[0]++],
];

describe("rules of the directory", () => {
  it("of ROOT are applied in their order", () => {
    ROOT_FAULTS.forEach(([id, lie], i) => {
      refuses(() => openedFront(repack(file, { pageBits: 1, lie })), id);
      const [before, earlier] = ROOT_FAULTS[Math.max(i - 1, 0)];
      const both = (root: PackedRoot) => [lie, ...(i > 0 ? [earlier] : [])].forEach((one) => one(root));
      refuses(() => openedFront(repack(file, { pageBits: 1, lie: both })), before);
    });
  });

  it("of pages are applied to each page", () => {
    for (const [id, change] of PAGE_FAULTS) refuses(() => openedFront(repack(file, { pageBits: 1, change })), id);
    refuses(() => openedFront(repack(file, { lie: ({ pages }) => (pages[0].tile_crc32 ^= 1) })), "page-crc-mismatch");
    refuses(() => openedFront(repack(file, { lie: ({ pages }) => (pages[0].rows[1].row_crc32 ^= 1) })), "page-crc-mismatch");
  });

  it("of the header come first", () => {
    refuses(() => openedFront(withHeader((view) => view.setUint8(31, 17))), "bad-page-bits");
    refuses(() => openedFront(withHeader((view) => view.setUint8(10, 1))), "unsupported-version");
    refuses(() => openedFront(withHeader((view) => view.setUint32(96, 0))), "directory-crc-mismatch");
    refuses(() => openedFront(withHeader((view) => view.setUint32(36, 2 ** 20, true))), "layer-offset");
  });

  it("let a ROOT of more pages than it has bytes cost no memory", () => {
    const many = withHeader((view) => {
      view.setUint32(32, 2 ** 20, true);
      view.setUint8(31, 0);
    });
    refuses(() => openedFront(many), "payload-short");
  });

  it("know the longest header", () => assert.equal(MOST_HEADER, 2280));
});

describe("STREAMING", () => {
  const tiles = 2;
  const bytes = (...middle: number[]) => Uint8Array.from([tiles, ...middle, ...Array(6).fill(1), ...Array(6).fill(9), 5, 6]);

  it("gives boxes of tiles and a view", () => {
    const { view, low, high, reach } = parseStreaming(bytes(0));
    assert.deepEqual([view, [...low], [...high], [...reach]], [null, Array(6).fill(1), Array(6).fill(9), [5, 6]]);
    const numbers = new Uint8Array(Float32Array.of(1, 2, 3, 4, 5, 6, 0, -1, 0, 0.5).buffer);
    assert.deepEqual(parseStreaming(bytes(1, ...numbers)).view, [1, 2, 3, 4, 5, 6, 0, -1, 0, 0.5]);
  });

  it("is refused where it is cut, too long, or names no view", () => {
    refuses(() => parseStreaming(bytes(0).subarray(0, -1)), "payload-short");
    refuses(() => parseStreaming(Uint8Array.from([...bytes(0), 0])), "payload-long");
    refuses(() => parseStreaming(bytes(1, ...Array(40).fill(0))), "bad-streaming");
  });
});

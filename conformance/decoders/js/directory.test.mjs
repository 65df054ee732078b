/** Tests of ROOT and pages: the same tiles and blocks in pages of any size, each page alone, each rule in its place. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { describe, it } from "node:test";
import { fileURLToPath } from "node:url";

import { DEFAULT_LIMITS } from "./constants.js";
import { readContainer, readFront } from "./container.js";
import { crc32 } from "./crc32.js";
import { Refused } from "./errors.js";
import { repack, varint } from "./packing.mjs";
import { readRowPage, readTilePage } from "./pages.js";
import { memorySource } from "./source.js";

const VECTORS = join(dirname(fileURLToPath(import.meta.url)), "../../vectors");
const bytes = new Uint8Array(readFileSync(join(VECTORS, "valid/index-grid/input.scar")));
const container = open(bytes);
const { tile_count: tiles, layer_count: layers } = container.header;

/** @param {Uint8Array} file @param {object} [limits] */
function open(file, limits = {}) {
  return readContainer(memorySource(file), { ...DEFAULT_LIMITS, ...limits }, false);
}

/** @param {() => unknown} action @param {string} id */
function refuses(action, id) {
  assert.throws(action, (error) => {
    if (!(error instanceof Refused)) return false;
    assert.equal(error.id, id, error.message);
    return true;
  });
}

/** A file whose header was changed, checksum and all. */
function withHeader(change) {
  const file = bytes.slice();
  const view = new DataView(file.buffer);
  change(view);
  const end = container.header.header_length - 4;
  view.setUint32(end, crc32(file.subarray(0, end)), true);
  return file;
}

describe("pages", () => {
  it("of any size tell of the same tiles and the same blocks", () => {
    assert.ok(tiles >= 3 && layers >= 2, "there is something to cut");
    for (const pageBits of [0, 1, 2, 16]) {
      const other = open(repack(container, { pageBits }));
      assert.equal(other.header.page_bits, pageBits);
      assert.deepEqual(other.tiles, container.tiles);
      for (const name of ["kind", "flags", "layer", "tile", "length", "count", "crc32"]) {
        assert.deepEqual(other.entries[name], container.entries[name], name);
      }
      other.entries.kind.forEach((_, e) => {
        const block = (of) => of.source.read(of.entries.offset[e], of.entries.length[e]);
        assert.deepEqual(block(other), block(container));
      });
    }
  });

  it("are read one by one from nothing but header, ROOT and their own bytes", () => {
    const file = repack(container, { pageBits: 1 });
    const whole = open(file);
    const asked = [];
    const source = { length: file.length, read: (at, n) => (asked.push([at, at + n]), file.subarray(at, at + n)) };
    const { header, root } = readFront(source, DEFAULT_LIMITS, false);
    assert.ok(asked.every(([, end]) => end <= header.header_length + header.root_length));
    const part = ({ offset, length }, p) => file.subarray(offset[p], offset[p] + length[p]);
    const found = readTilePage(part(root.tilePages, 1), header, root, 1);
    assert.deepEqual([...found.prefix], [...whole.tiles.prefix.subarray(2, 4)]);
    const rows = readRowPage(part(root.rowPages[1], 1), header, root, { layer: 2, page: 1 }, DEFAULT_LIMITS);
    const { kind, layer, tile, count } = whole.entries;
    const own = [...kind.keys()].filter((e) => kind[e] === 16 && layer[e] === 2 && tile[e] >> 1 === 1);
    assert.deepEqual([...rows.count].filter((_, i) => rows.length[i] > 0), own.map((e) => count[e]));
  });

  it("hold cubes up to the last one, which ends at 2^63", () => {
    const prefix = [0n, 2n ** 62n + 1n, 2n ** 63n - 2n, 2n ** 63n - 1n];
    const gaps = prefix.map((code, i) => (i === 0 ? code : code - prefix[i - 1] - 1n));
    const read = (past) => tilePage({ depth: [21, 21, 21, 21], gaps: [...gaps.slice(0, 3), past] }, 0n);
    assert.deepEqual([...read(0n).prefix], prefix);
    refuses(() => read(1n), "tile-prefix");
  });

  it("begin where ROOT says, and end before the next one begins", () => {
    const page = { depth: [20, 21], gaps: [0n, 3n] };
    assert.deepEqual([...tilePage(page, 8n, 20n).prefix], [1n, 19n]);
    refuses(() => tilePage(page, 8n, 19n), "tile-order");
    refuses(() => tilePage(page, 9n), "tile-order");
    refuses(() => tilePage({ depth: [20, 21], gaps: [1n, 3n] }, 8n), "tile-order");
  });
});

/** What is read of a tile page that begins at `base`, before another one that begins at `end`. */
function tilePage({ depth, gaps }, base, end = null) {
  const page = Uint8Array.from([...depth, ...depth.map(() => 0), ...gaps.flatMap(varint)]);
  const tilePages = { offset: [0], length: [page.length], crc32: [crc32(page)] };
  const header = { ...container.header, page_bits: 2, tile_count: depth.length, lattice_bits: 21 };
  return readTilePage(page, header, { pages: end === null ? 1 : 2, base: [base, end], tilePages }, 0);
}

/** Refusals in the order of their rules; a file with two faults has the first of them. */
const ROOT_FAULTS = [
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

const PAGE_FAULTS = [
  ["page-crc-mismatch", {}, ({ pages }) => (pages[0].tile_crc32 ^= 1)],
  ["payload-short", { change: ({ tiles: [page] }) => [page.shift.pop(), (page.gap[1] = 2n ** 14n)] }],
  ["payload-long", { change: ({ tiles: [page] }) => page.gap.push(0n) }],
  ["tile-depth", { change: ({ tiles: [{ depth }] }) => (depth[0] = 22) }],
  ["tile-shift", { change: ({ tiles: [{ shift }] }) => (shift[0] = 32) }],
  ["tile-local-bits", { change: ({ tiles: [{ shift }] }) => (shift[0] = 31) }],
  ["tile-prefix", { change: ({ tiles: [{ gap }] }) => (gap[1] = 2n ** 62n) }],
  ["tile-order", { change: ({ tiles: [{ gap }] }) => gap[0]++ }],
  ["page-crc-mismatch", {}, ({ pages }) => (pages[0].rows[1].row_crc32 ^= 1)],
  ["payload-short", { change: ({ rows: [[page]] }) => page.crc32.pop() }],
  ["payload-long", { change: ({ rows: [[page]] }) => page.crc32.push(0) }],
  ["page-sums", { change: ({ rows: [[page]] }) => page.count[0]++ }],
  ["page-sums", { change: ({ rows: [, [page]] }) => page.length[0]++ }],
];

describe("rules of the directory", () => {
  for (const [id, lie] of ROOT_FAULTS) {
    it(`ROOT: ${id}`, () => refuses(() => open(repack(container, { pageBits: 1, lie })), id));
  }

  it("ROOT: the first rule broken is the one told of", () => {
    for (let i = 1; i < ROOT_FAULTS.length; i++) {
      const lie = (root) => [ROOT_FAULTS[i], ROOT_FAULTS[i - 1]].forEach(([, one]) => one(root));
      refuses(() => open(repack(container, { pageBits: 1, lie })), ROOT_FAULTS[i - 1][0]);
    }
  });

  for (const [id, { change }, lie] of PAGE_FAULTS) {
    it(`pages: ${id}`, () => refuses(() => open(repack(container, { pageBits: 1, change, lie })), id));
  }

  it("a page is looked at only after all before it: tile pages, then row pages by layer", () => {
    const tileFault = ({ tiles: pages }) => (pages.at(-1).depth[0] = 22);
    const rowFault = ({ rows }) => rows[0][0].count[0]++;
    const change = (directory) => [tileFault, rowFault].forEach((one) => one(directory));
    refuses(() => open(repack(container, { pageBits: 1, change })), "tile-depth");
  });

  it("limits are those of the reader", () => {
    refuses(() => open(bytes, { block_bytes: 20 }), "limit-block-bytes");
    refuses(() => open(bytes, { tile_anchors: 1 }), "limit-tile-anchors");
    refuses(() => open(bytes, { root_bytes: 20 }), "limit-root");
  });

  it("the header says how long ROOT is, what it adds up to, and how large pages are", () => {
    refuses(() => open(withHeader((view) => view.setUint8(31, 17))), "bad-page-bits");
    refuses(() => open(withHeader((view) => view.setUint8(10, 1))), "unsupported-version");
    refuses(() => open(withHeader((view) => view.setUint32(96, 0))), "directory-crc-mismatch");
    refuses(() => open(withHeader((view) => view.setUint32(36, 2 ** 20, true))), "layer-offset");
  });

  it("a ROOT of more pages than it has bytes is short, and costs no memory", () => {
    const file = withHeader((view) => {
      view.setUint32(32, 2 ** 20, true);
      view.setUint8(31, 0);
    });
    refuses(() => open(file), "payload-short");
  });
});

/** Directories in many pages: only those needed are read, and what goes wrong with one stays with its tiles. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import type { Planner } from "../src/plan/types.js";
import { type Directory, parseFront } from "../src/format/directory.js";
import type { StreamOptions } from "../src/stream/scar_stream.js";
import { toys, vector } from "./files.js";
import { assertComplete, assertShown, cameraAt, streaming, type Watched } from "./watching.js";

const PAGES = 12;
/** Two in a page. */
const TILES = 24;
const bytes = toys();
const directory = parseFront(bytes, bytes.length);
const { numbers, entries } = directory;
/** Bytes of header and ROOT. */
const FRONT = directory.header.header_length + directory.header.root_length;
/** Pages only where the plan needs them. */
const byNeed: StreamOptions = { firstBytes: FRONT, frontBytes: 0 };

/** Tiles x to x + 3 alone. */
const four: Planner = {
  plan({ layers }, camera, have) {
    const first = camera?.position[0] ?? 0;
    const tiles = [first, first + 1, first + 2, first + 3];
    const all = Array.from({ length: layers }, (_, k) => tiles.map((tile) => ({ tile, layer: k + 1 })));
    return all.flat().filter(({ tile, layer }) => have[tile] < layer);
  },
};

const onlyFirst: Planner = {
  plan: (_index, _camera, have) => {
    return [...have.keys()].filter((tile) => have[tile] === 0).map((tile) => ({ tile, layer: 1 }));
  },
};

/** Pages that a stream has opened. */
function opened({ stream }: Watched): (page: number) => boolean {
  const front = stream.front as Directory;
  return (page) => front.isOpen(page);
}

function damaged(entry: number): Uint8Array {
  return bytes.map((b, i) => (i === entries.offset[entry] + 3 ? b ^ 4 : b));
}

describe("a directory in pages", () => {
  it("is read as it is needed, to the same scene", async () => {
    for (const firstBytes of [FRONT, FRONT + 300]) {
      await streaming(bytes, { ...byNeed, firstBytes }, async (watched) => {
        const stats = await watched.end();
        assertComplete(watched, bytes);
        assert.deepEqual(watched.errors, []);
        assert.ok(stats.bytesRead < 1.05 * bytes.length, `${stats.bytesRead} bytes read of ${bytes.length}`);
      });
    }
  });

  it("has no page read that nothing is wanted of, until the view wants it", async () => {
    await streaming(bytes, { ...byNeed, planner: four, camera: cameraAt(8), replanMs: 0 }, async (watched) => {
      await watched.end();
      assert.deepEqual([...watched.shown.keys()].toSorted(), [10, 11, 8, 9]);
      const isOpen = opened(watched);
      assert.ok(isOpen(numbers.tilePage(4)) && isOpen(numbers.rowPage(5, 5)));
      const others = [...Array(PAGES).keys()].filter((page) => page !== 4 && page !== 5);
      for (const page of others) assert.equal(isOpen(numbers.rowPage(5, page)), false);
      watched.stream.setView(cameraAt(20));
      await watched.end();
      assert.ok(isOpen(numbers.rowPage(5, 10)) && !isOpen(numbers.rowPage(5, 9)));
      for (const tile of [20, 21, 22, 23]) assert.equal(watched.shown.get(tile)?.layer, 5);
      assertShown(watched.shown, bytes);
    });
  });

  it("shows layer 1 of a large scene before it knows of later layers", async () => {
    const end = entries.offset[numbers.rowPage(2, 0)];
    await streaming(bytes, { ...byNeed, frontBytes: end, planner: onlyFirst }, async (watched, server) => {
      const { tilesAtLayer } = await watched.end();
      assert.deepEqual(tilesAtLayer, [TILES, 0, 0, 0, 0]);
      assertShown(watched.shown, bytes);
      const isOpen = opened(watched);
      for (let page = 0; page < PAGES; page++) assert.equal(isOpen(numbers.rowPage(2, page)), false);
      assert.deepEqual(server.asked[1].range, [FRONT, end - 1], "one stretch at the start of the file");
      assert.ok(server.asked.every(({ range }) => range![1] < directory.layers[0].end_offset));
    });
  });
});

describe("a page", () => {
  const tilePage = numbers.tilePage(3);
  const rowPage = numbers.rowPage(3, 3);

  it("of tiles that is damaged on the disk keeps its tiles away, and no others", async () => {
    await streaming(damaged(tilePage), byNeed, async (watched) => {
      const { tilesAtLayer } = await watched.end();
      const told = watched.errors.map(({ id, offset, fatal }) => [id, offset, fatal]);
      assert.deepEqual(told, [["page-crc-mismatch", entries.offset[tilePage], false]]);
      assert.deepEqual(tilesAtLayer, Array(5).fill(TILES - 2));
      assertShown(watched.shown, bytes);
    });
  });

  it("of rows that is damaged on the disk keeps its tiles at the layer before", async () => {
    await streaming(damaged(rowPage), byNeed, async (watched) => {
      const { tilesAtLayer } = await watched.end();
      assert.deepEqual(watched.errors.map(({ id, layer }) => [id, layer]), [["page-crc-mismatch", 3]]);
      assert.deepEqual(tilesAtLayer, [TILES, TILES, TILES - 2, TILES - 2, TILES - 2]);
      for (let tile = 6; tile < 8; tile++) assert.equal(watched.shown.get(tile)?.layer, 2);
      assertShown(watched.shown, bytes);
    });
  });

  it("that breaks a rule ends the stream, by that rule", async () => {
    await streaming(vector("invalid/tile-depth-22"), byNeed, async (watched) => {
      await watched.end();
      assert.deepEqual(watched.errors.map(({ id, fatal }) => [id, fatal]), [["tile-depth", true]]);
    });
  });
});

/** Directories in many pages: only those needed are read, and what goes wrong with one stays with its tiles. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import type { Camera, Planner } from "../src/plan/types.js";
import { type Directory, parseFront } from "../src/format/directory.js";
import type { StreamOptions } from "../src/stream/scar_stream.js";
import { toys, WholeFile } from "./files.js";
import { repack, replicated } from "./packing.js";
import { type FileServer, serving, type Trick } from "./server.js";
import { assertComplete, assertShown, type Watched, watching } from "./watching.js";

/** 192 tiles in 24 pages. */
const bytes = replicated(new WholeFile(toys()), 1, 3);
const TILES = 192;
const directory = parseFront(bytes, bytes.length);
const { numbers, entries } = directory;
/** Pages only where the plan needs them. */
const byNeed: StreamOptions = { firstBytes: 2280, frontBytes: 0 };

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

const at = (x: number): Camera => ({
  position: [x, 0, 0],
  forward: [0, 0, 1],
  up: [0, -1, 0],
  fovY: 1,
  width: 640,
  height: 480,
});

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
    for (const firstBytes of [2280, 5000]) {
      await serving(bytes, async (url) => {
        await watching(url, { ...byNeed, firstBytes }, async (watched) => {
          const stats = await watched.end();
          assertComplete(watched, bytes);
          assert.deepEqual(watched.errors, []);
          assert.ok(stats.bytesRead < 1.02 * bytes.length, `${stats.bytesRead} bytes read of ${bytes.length}`);
        });
      });
    }
  });

  it("is read without ranges, too", async () => {
    await serving(bytes, async (url, server) => {
      server.ranges = false;
      await watching(url, byNeed, async (watched) => {
        await watched.end();
        assertComplete(watched, bytes);
        assert.equal(server.asked.length, 1);
      });
    });
  });

  it("has no page read that nothing is wanted of, until the view wants it", async () => {
    await serving(bytes, async (url) => {
      await watching(url, { ...byNeed, planner: four, camera: at(8), replanMs: 0 }, async (watched) => {
        await watched.end();
        assert.deepEqual([...watched.shown.keys()].toSorted(), [10, 11, 8, 9]);
        const isOpen = opened(watched);
        assert.ok(isOpen(numbers.tilePage(1)) && isOpen(numbers.rowPage(5, 1)));
        const others = [...Array(24).keys()].filter((page) => page !== 1);
        for (const page of others) assert.equal(isOpen(numbers.rowPage(5, page)), false);
        watched.stream.setView(at(180));
        await watched.end();
        assert.ok(isOpen(numbers.rowPage(5, 22)) && !isOpen(numbers.rowPage(5, 21)));
        for (const tile of [180, 181, 182, 183]) assert.equal(watched.shown.get(tile)?.layer, 5);
        assertShown(watched.shown, bytes);
      });
    });
  });

  it("shows layer 1 of a large scene before it knows of later layers", async () => {
    await serving(bytes, async (url, server) => {
      const end = entries.offset[numbers.rowPage(2, 0)];
      await watching(url, { ...byNeed, frontBytes: end, planner: onlyFirst }, async (watched) => {
        const { tilesAtLayer } = await watched.end();
        assert.deepEqual(tilesAtLayer, [TILES, 0, 0, 0, 0]);
        assertShown(watched.shown, bytes);
        const isOpen = opened(watched);
        for (let page = 0; page < 24; page++) assert.equal(isOpen(numbers.rowPage(2, page)), false);
        assert.deepEqual(server.asked[1].range, [2280, end - 1], "one stretch at the start of the file");
        assert.ok(server.asked.every(({ range }) => range![1] < directory.layers[0].end_offset));
      });
    });
  });

  it("is put right where boxes and sizes were those of pages", async () => {
    await serving(bytes, async (url) => {
      await watching(url, byNeed, async (watched) => {
        const front = await watched.stream.ready;
        const before = front.index.bytes.slice();
        await watched.end();
        for (const { tile, layer, length } of new WholeFile(bytes).blocks) {
          if (tile !== null) assert.equal(front.index.bytes[tile * 5 + layer - 1], length);
        }
        assert.notDeepEqual(before, front.index.bytes);
      });
    });
  });
});

/** Answers a request with what a change makes of the file. */
function answering(server: FileServer, changed: Uint8Array, when: (number: number) => boolean): Trick {
  return ({ range }, response, number) => {
    if (!when(number)) return false;
    const body = changed.subarray(range![0], range![1] + 1);
    response.writeHead(206, server.rangeHeaders(range!)).end(body);
    return true;
  };
}

describe("a page", () => {
  const tilePage = numbers.tilePage(3);
  const rowPage = numbers.rowPage(3, 3);

  it("that is damaged on its way is read again", async () => {
    for (const page of [tilePage, rowPage]) {
      await serving(bytes, async (url, server) => {
        server.trick = answering(server, damaged(page), (number) => number === 2);
        await watching(url, byNeed, async (watched) => {
          await watched.end();
          assertComplete(watched, bytes);
          assert.deepEqual(watched.errors, []);
        });
      });
    }
  });

  it("that is cut is read on, and what came of it is kept", async () => {
    await serving(bytes, async (url, server) => {
      server.trick = ({ range }, response, number) => {
        const [first, last] = range!;
        const cut = entries.offset[tilePage] + 4;
        if (number > 3 || first >= cut || last < cut) return false;
        response.writeHead(206, server.rangeHeaders(range!));
        response.write(bytes.subarray(first, cut), () => response.destroy());
        return true;
      };
      await watching(url, byNeed, async (watched) => {
        await watched.end();
        assertComplete(watched, bytes);
        assert.ok(watched.retries.length > 0);
      });
    });
  });

  it("of tiles that is damaged on the disk keeps its tiles away, and no others", async () => {
    await serving(damaged(tilePage), async (url) => {
      await watching(url, byNeed, async (watched) => {
        const { tilesAtLayer } = await watched.end();
        const told = watched.errors.map(({ id, offset, fatal }) => [id, offset, fatal]);
        assert.deepEqual(told, [["page-crc-mismatch", entries.offset[tilePage], false]]);
        assert.deepEqual(tilesAtLayer, Array(5).fill(TILES - 8));
        assertShown(watched.shown, bytes);
      });
    });
  });

  it("of rows that is damaged on the disk keeps its tiles at the layer before", async () => {
    await serving(damaged(rowPage), async (url) => {
      await watching(url, byNeed, async (watched) => {
        const { tilesAtLayer } = await watched.end();
        assert.deepEqual(watched.errors.map(({ id, layer }) => [id, layer]), [["page-crc-mismatch", 3]]);
        assert.deepEqual(tilesAtLayer, [TILES, TILES, TILES - 8, TILES - 8, TILES - 8]);
        for (let tile = 24; tile < 32; tile++) assert.equal(watched.shown.get(tile)?.layer, 2);
        assertShown(watched.shown, bytes);
      });
    });
  });

  it("that breaks a rule ends the stream, by that rule", async () => {
    const broken = repack(new WholeFile(bytes), { pageBits: 3, change: ({ tiles }) => (tiles[3].depth[1] = 22) });
    await serving(broken, async (url) => {
      await watching(url, byNeed, async (watched) => {
        await watched.end();
        assert.deepEqual(watched.errors.map(({ id, fatal }) => [id, fatal]), [["tile-depth", true]]);
      });
    });
  });

  it("of another version of the file is not taken", async () => {
    await serving(bytes, async (url, server) => {
      server.trick = (_, _response, number) => {
        if (number === 2) server.etag = '"two"';
        return false;
      };
      await watching(url, byNeed, async (watched) => {
        await watched.end();
        assert.deepEqual(watched.errors.map(({ id, fatal }) => [id, fatal]), [["file-changed", true]]);
        assert.equal(watched.shown.size, 0);
      });
    });
  });
});

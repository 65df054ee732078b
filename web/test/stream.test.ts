/** A stream from a server that behaves: what arrives, in what order, and at what cost. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { openedFront, toys, vector, WholeFile } from "./files.js";
import { assertComplete, cameraAt, streaming, watching } from "./watching.js";

const bytes = toys();

describe("a stream", () => {
  it("delivers every tile after every layer, as a direct decode does", async () => {
    await streaming(bytes, {}, async (watched) => {
      const stats = await watched.end();
      assertComplete(watched, bytes);
      assert.deepEqual(watched.errors, []);
      assert.deepEqual(stats.tilesAtLayer, [24, 24, 24, 24, 24]);
      assert.equal(stats.splatsShown, 10914);
      assert.ok(stats.layerAt.every((at) => at !== null));
    });
  });

  it("tells the front first, and in it how many Gaussians will come", async () => {
    await streaming(bytes, {}, async (watched) => {
      const order: string[] = [];
      watched.stream.on("front", () => order.push("front"));
      watched.stream.on("tile", () => order.push("tile"));
      const front = await watched.stream.ready;
      await watched.end();
      assert.deepEqual([order.indexOf("front"), order.lastIndexOf("front")], [0, 0]);
      const { layers, counts } = front.index;
      for (const { tile, layer, count } of watched.tiles) {
        const appeared = counts.subarray(tile * layers, tile * layers + layer).reduce((a, b) => a + b, 0);
        assert.equal(count, appeared);
      }
      assert.equal(front.total, 10914);
    });
  });

  it("decodes in the order of the plan, where decoders are slower than the server", async () => {
    await watching(new Blob([bytes.slice()]), {}, async (watched) => {
      await watched.end();
      const layers = watched.tiles.map(({ layer }) => layer);
      assert.deepEqual(layers, layers.toSorted());
      assert.equal(layers.filter((layer) => layer === 1).length, 24);
    });
  });

  it("asks for no byte of a block twice, in few requests", async () => {
    const [first] = new WholeFile(bytes).blocks;
    await streaming(bytes, { prepare: (server) => (server.delay = 5) }, async (watched, server) => {
      const stats = await watched.end();
      const times = new Uint8Array(bytes.length);
      for (const { range } of server.asked) for (let at = range![0]; at <= range![1]; at++) times[at]++;
      assert.equal(
        times.subarray(first.offset).findIndex((n) => n !== 1),
        -1,
      );
      assert.equal(server.asked.length, stats.requests);
      assert.ok(stats.requests <= 4, `${stats.requests} requests for ${bytes.length} bytes`);
      assert.equal(stats.bytesRead, bytes.length);
    });
  });

  it("gives what the block STREAMING says, and plans by it", async () => {
    const file = vector("valid/streaming");
    await streaming(file, {}, async (watched) => {
      const found: unknown[] = [];
      watched.stream.on("streaming", (streaming) => found.push(streaming));
      await watched.end();
      assertComplete(watched, file);
      const { index } = watched.stream.front!;
      assert.equal(index.streaming?.tiles, index.tiles);
      assert.deepEqual(found, [index.streaming]);
    });
  });

  it("gives the small picture of a file before its tiles, and does without one that is damaged", async () => {
    const file = vector("valid/annotations");
    const { numbers, entries } = openedFront(file);
    const entry = numbers.blockOfFirst(15);
    const picture = file.slice(entries.offset[entry], entries.offset[entry] + entries.length[entry]);
    const damaged = file.slice();
    damaged[entries.offset[entry]] ^= 1;
    for (const [whole, expected] of [
      [file, [picture, "tile"]],
      [damaged, ["tile"]],
    ] as const) {
      await streaming(whole, {}, async (watched) => {
        const found: unknown[] = [];
        watched.stream.on("thumbnail", (bytes) => found.push(bytes));
        watched.stream.on("tile", () => found.includes("tile") || found.push("tile"));
        await watched.end();
        assertComplete(watched, file);
        assert.deepEqual(found, expected);
        assert.deepEqual(watched.errors, []);
      });
    }
  });

  it("goes by the view unless it is told otherwise: what is in the picture comes first", async () => {
    const { index } = openedFront(bytes);
    const middle = (tile: number, axis: number) =>
      (index.boxes[6 * tile + axis] + index.boxes[6 * tile + 3 + axis]) / 2;
    const target = 17;
    const eye = [0, 1, 2].map((axis) => middle(target, axis) - (axis === 2 ? 0.05 : 0)) as [number, number, number];
    await streaming(bytes, { camera: { ...cameraAt(0), position: eye, fovY: 0.1 } }, async (watched) => {
      await watched.end();
      assertComplete(watched, bytes);
      const place = watched.tiles.findIndex(({ tile }) => tile === target);
      assert.ok(place < 12, `tile ${target} was number ${place}, in file order it would be number 17`);
    });
  });

  it("reads a file of the user, and what a function has in place of a server", async () => {
    const fetch = async (_: unknown, asked?: RequestInit) => {
      const [first, last] = new Headers(asked!.headers).get("Range")!.match(/\d+/g)!.map(Number);
      return new Response(bytes.slice(first, last + 1), { status: 206 });
    };
    for (const source of [new Blob([bytes.slice()]), "archive:toys.scar"]) {
      await watching(source, { fetch }, async (watched) => {
        await watched.end();
        assertComplete(watched, bytes);
      });
    }
  });

  it("makes Gaussians of anchors again where the camera has moved", async () => {
    const anchors = vector("valid/anchors");
    await watching(new Blob([anchors.slice()]), { camera: cameraAt(30), replanMs: 0 }, async (watched) => {
      await watched.end();
      const before = watched.tiles.length;
      const colours = new Map(
        [...watched.shown].map(([tile, { output }]) => [tile, "sh" in output ? output.sh : null]),
      );
      watched.stream.setView(cameraAt(30.01));
      await watched.end();
      assert.equal(watched.tiles.length, before, "a small step changes nothing");
      watched.stream.setView(cameraAt(-60));
      await watched.end();
      assert.ok(watched.tiles.length > before);
      for (const { tile, output } of watched.tiles.slice(before))
        assert.notDeepEqual("sh" in output && output.sh, colours.get(tile));
    });
  });

  it("asks for nothing more when it is closed by who sees the front", async () => {
    await streaming(bytes, {}, async (watched, server) => {
      watched.stream.on("front", () => watched.stream.close());
      await assert.rejects(watched.stream.ready);
      await new Promise((resolve) => setTimeout(resolve, 100));
      assert.equal(server.asked.length, 1);
      assert.equal(watched.tiles.length, 0);
    });
  });
});

/** Servers that misbehave: what a stream mends, what it says, and what stays on the screen. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { type FileBlock, toys, vector, WholeFile } from "./files.js";
import { BLOCK } from "../src/format/registry.js";
import type { Stats, StreamOptions } from "../src/stream/scar_stream.js";
import { serving, type FileServer, type Trick } from "./server.js";
import { assertComplete, assertShown, cameraAt, streaming, Watched, watching } from "./watching.js";

const bytes = toys();
const file = new WholeFile(bytes);
const { header } = file.front;
/** Where the directory ends. */
const start = file.blocks[0].offset;

/** Answers some requests with a status. */
function failing(status: number, when: (number: number) => boolean): Trick {
  return (_, response, number) => {
    if (!when(number)) return false;
    response.writeHead(status).end("no");
    return true;
  };
}

/** Sends only part of what is asked for, then cuts the connection or falls silent. */
function partly(server: FileServer, share: number, cut: boolean, when: (number: number) => boolean): Trick {
  return ({ range }, response, number) => {
    if (!when(number)) return false;
    const [first, last] = server.ranges && range !== null ? range : [0, server.bytes.length - 1];
    const end = Math.min(last + 1, server.bytes.length);
    if (range === null || !server.ranges)
      response.writeHead(200, { "Content-Length": String(end), ETag: server.etag! });
    else response.writeHead(206, server.rangeHeaders(range));
    response.write(server.bytes.subarray(first, first + Math.floor((end - first) * share)), () => {
      if (cut) response.destroy();
    });
    return true;
  };
}

/** Expects that the scene comes whole, without an error, from a server that misbehaves. */
async function completes(prepare: (server: FileServer) => void, options: StreamOptions = {}): Promise<{ stats: Stats; server: FileServer }> {
  let found: { stats: Stats; server: FileServer };
  await streaming(bytes, { prepare, ...options }, async (watched, server) => {
    found = { stats: await watched.end(), server };
    assert.deepEqual(watched.errors, []);
    assertComplete(watched, bytes);
  });
  return found!;
}

describe("a server without ranges", () => {
  it("is read once, and tiles come while it is read", async () => {
    let release: () => void = () => undefined;
    await streaming(bytes, { prepare: (server) => (release = server.holdAfter(60_000)) }, async (watched, server) => {
      await new Promise<void>((resolve) => watched.stream.on("tile", () => watched.shown.size === 24 && resolve()));
      const layers = [...watched.shown.values()].map(({ layer }) => layer);
      assert.ok(layers.every((layer) => layer < 5), "tiles are there before the rest");
      release();
      await watched.end();
      assertComplete(watched, bytes);
      assert.equal(server.asked.length, 1);
    });
  });

  it("is read again where it is cut, and only what is missing is taken", async () => {
    const { stats, server } = await completes((server) => {
      server.ranges = false;
      server.trick = partly(server, 0.6, true, (number) => number === 1);
    });
    assert.equal(server.asked.length, 2);
    assert.equal(stats.bytesUsed, bytes.length - start - lengthOfMetadata());
  });
});

/** METADATA is not fetched. */
function lengthOfMetadata(): number {
  return file.blocks.reduce((sum, { kind, length }) => sum + (kind === BLOCK.METADATA ? length : 0), 0);
}

describe("a server that fails now and then", () => {
  it("cuts connections midway: what came is kept, to the byte", async () => {
    const { stats } = await completes((server) => {
      server.trick = partly(server, 0.5, true, (number) => number > 1 && number % 2 === 0);
    });
    assert.ok(stats.retries > 0);
    assert.ok(stats.bytesRead <= bytes.length, `${stats.bytesRead} bytes were read`);
  });

  it("cuts the front", async () => {
    await completes((server) => (server.trick = partly(server, 0.02, true, (number) => number < 3)));
  });

  it("sends a damaged front, once", async () => {
    const damaged = bytes.map((b, i) => (i === start - 9 ? b ^ 2 : b));
    await completes((server) => {
      server.trick = (_, _response, number) => {
        server.bytes = number === 1 ? damaged : bytes;
        return false;
      };
    });
  });
});

/** Numbers in [0, 1), the same for a seed. */
function chance(seed: number): () => number {
  let state = seed;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

describe("a server in bad weather", () => {
  for (const seed of [1, 2, 3]) {
    it(`gives the same scene in the end: ${seed}`, async () => {
      const next = chance(seed);
      const weather = (server: FileServer) => {
        server.ranges = seed !== 3;
        const tricks = [
          failing(503, () => true),
          partly(server, 0.7, true, () => true),
          partly(server, 0.4, false, () => true),
          (({ range }, response) => {
            const part = server.ranges ? bytes.slice(range![0], range![1] + 1) : bytes.slice();
            part[Math.floor(next() * part.length)] ^= 4;
            if (server.ranges) response.writeHead(206, server.rangeHeaders(range!));
            else response.writeHead(200, { "Content-Length": part.length, ETag: server.etag! });
            response.end(part);
            return true;
          }) satisfies Trick,
        ];
        server.trick = (asked, response, number) =>
          number === 1
            ? !server.ranges && tricks[1](asked, response, number)
            : next() < 0.5 && tricks[Math.floor(next() * tricks.length)](asked, response, number);
      };
      const { server } = await completes(weather, { stallMs: 80, retry: { retries: 30, firstMs: 1, mostMs: 5 } });
      assert.ok(server.asked.length > 2);
    });
  }
});

describe("what a server says of a file", () => {
  it("is asked to hold: If-Range has the ETag of the first answer", async () => {
    const { server } = await completes(() => undefined);
    const conditions = server.asked.map(({ headers }) => headers["if-range"]);
    assert.deepEqual(conditions, server.asked.map((_, i) => (i === 0 ? undefined : '"one"')));
  });

  it("may be hidden, as from pages of another origin", async () => {
    await completes((server) => {
      server.trick = ({ range }, response) => {
        response.writeHead(206).end(bytes.subarray(range![0], range![1] + 1));
        return true;
      };
    });
  });

  it("is not taken where ranges are compressed, or begin elsewhere", async () => {
    for (const [headers, id] of [
      [{ "Content-Encoding": "gzip" }, "encoded"],
      [{ "Content-Range": "bytes 7-9/10" }, "no-range"],
    ] as const) {
      await serving(bytes, async (url, server) => {
        server.trick = (_, response) => {
          response.writeHead(206, headers).end();
          return true;
        };
        await watching(url, { retry: { retries: 1, firstMs: 1, mostMs: 1 } }, async (watched) => {
          await assert.rejects(watched.stream.ready, { id, status: 206, source: url });
        });
      });
    }
  });
});

/** The file with one bit of a block turned, as it lies on a disk that failed. */
function withDamage({ offset, length }: FileBlock): Uint8Array {
  const damaged = bytes.slice();
  damaged[offset + Math.floor(length / 2)] ^= 1;
  return damaged;
}

describe("what cannot be mended", () => {
  it("leaves a tile with a damaged block at the layer before, and goes on with others", async () => {
    const block = file.find(16, 3, 7)!;
    await streaming(withDamage(block), {}, async (watched) => {
      const stats = await watched.end();
      assert.equal(watched.errors.length, 1);
      const [error] = watched.errors;
      assert.deepEqual([error.id, error.tile, error.layer, error.fatal], ["crc-mismatch", 7, 3, false]);
      assert.equal(error.offset, block.offset);
      assert.equal(watched.shown.get(7)!.layer, 2);
      assert.equal(stats.tilesAtLayer[4], 23);
      assertShown(watched.shown, bytes);
    });
  });

  it("leaves all tiles at the layer before damaged models", async () => {
    await streaming(withDamage(file.find(1, 4)!), {}, async (watched) => {
      const stats = await watched.end();
      assert.deepEqual(
        watched.errors.map(({ id, layer, fatal }) => [id, layer, fatal]),
        [["crc-mismatch", 4, false]],
      );
      assert.deepEqual(stats.tilesAtLayer, [24, 24, 24, 0, 0]);
      assertShown(watched.shown, bytes);
    });
  });

  it("is said by rule where a decoder refuses a block whose CRC is right", async () => {
    await streaming(vector("invalid/substream-crc"), {}, async (watched) => {
      await watched.end();
      const [error] = watched.errors;
      assert.deepEqual([error.id, error.tile, error.layer, error.fatal], ["crc-mismatch", 0, 1, false]);
    });
  });

  for (const ranges of [true, false]) {
    it(`is a file that changes while it is read${ranges ? "" : ", without ranges"}: nothing is mixed`, async () => {
      await serving(bytes, async (url, server) => {
        server.ranges = ranges;
        const cut = partly(server, 0.6, true, (number) => number === 1 && !ranges);
        server.trick = (asked, response, number) => {
          if (number === 2) {
            server.bytes = new Uint8Array(bytes.length).fill(7);
            server.etag = '"two"';
          }
          return cut(asked, response, number);
        };
        await watching(url, {}, async (watched) => {
          await watched.end();
          const [error] = watched.errors;
          assert.deepEqual([error.id, error.fatal, error.source], ["file-changed", true, url]);
          assert.ok(watched.shown.size > 0, "what is shown stays");
          assertShown(watched.shown, bytes);
        });
      });
    });
  }

  it("is noticed as a change by size and date where there is no ETag", async () => {
    await serving(bytes, async (url, server) => {
      server.etag = null;
      server.trick = (_, _response, number) => {
        if (number === 2) server.bytes = new Uint8Array([...bytes, 0]);
        return false;
      };
      await watching(url, {}, async (watched) => {
        await watched.end();
        assert.equal(watched.errors[0].id, "file-changed");
      });
    });
  });

  it("ends with a clear error after bounded tries, and goes on when asked to", async () => {
    await serving(bytes, async (url, server) => {
      let down = true;
      const fail = failing(500, (number) => number > 1 && down);
      server.trick = fail;
      await watching(url, { retry: { retries: 3, firstMs: 1, mostMs: 4 } }, async (watched) => {
        await watched.end();
        const [error] = watched.errors;
        assert.deepEqual([error.id, error.status, error.fatal], ["http-status", 500, true]);
        assert.ok(server.asked.length <= 1 + 4 * 4, `${server.asked.length} requests`);
        assert.ok(watched.shown.size > 0);
        down = false;
        watched.stream.resume();
        await watched.end();
        assertComplete(watched, bytes);
      });
    });
  });

  for (const [name, make, id] of [
    ["not a scene", () => new TextEncoder().encode("<!doctype html><title>404</title>".repeat(9)), "bad-signature"],
    ["an empty file", () => new Uint8Array(0), "http-status"],
    ["a file with bytes after its end", () => new Uint8Array([...bytes, 1]), "trailing-bytes"],
    ["a file that is cut short", () => bytes.slice(0, 90_000), "truncated-file"],
    [
      "a damaged ROOT",
      () => bytes.map((b, i) => (i === header.header_length + 5 ? b ^ 1 : b)),
      "directory-crc-mismatch",
    ],
    ["a damaged page", () => bytes.map((b, i) => (i === start - 20 ? b ^ 1 : b)), "page-crc-mismatch"],
  ] as const) {
    it(`is ${name}: refused at once`, async () => {
      await streaming(make(), {}, async (watched, server) => {
        await assert.rejects(watched.stream.ready, { id });
        assert.equal(watched.errors[0].id, id);
        assert.equal(watched.errors[0].fatal, true);
        assert.ok(server.asked.length <= 3);
      });
    });
  }

  it("is a server that is not there", async () => {
    await watching(
      "http://127.0.0.1:9/scene.scar",
      { retry: { retries: 2, firstMs: 1, mostMs: 2 } },
      async (watched) => {
        await assert.rejects(watched.stream.ready, { id: "network" });
        assert.equal(watched.retries.length, 2);
      },
    );
  });
});

describe("closing a stream", () => {
  for (const [name, trick] of [
    ["while the front is awaited", (server: FileServer) => partly(server, 0, false, () => true)],
    ["while tiles are under way", (server: FileServer) => partly(server, 0.3, false, (number) => number > 1)],
    ["while it waits to try again", () => failing(500, (number) => number > 1)],
    [
      "while a file is read without ranges",
      (server: FileServer) => {
        server.ranges = false;
        return partly(server, 0.5, false, () => true);
      },
    ],
  ] as const) {
    it(`leaves neither timers nor connections: ${name}`, async () => {
      const open = () => process.getActiveResourcesInfo().filter((one) => one === "Timeout").length;
      const before = open();
      await serving(bytes, async (url, server) => {
        server.trick = trick(server);
        const watched = new Watched(url, { retry: { retries: 9, firstMs: 60_000, mostMs: 60_000 }, stallMs: 60_000 });
        await new Promise((resolve) => setTimeout(resolve, 120));
        watched.stream.setView(cameraAt(0));
        watched.stream.close();
        for (let i = 0; i < 50 && server.pending > 0; i++) await new Promise((resolve) => setTimeout(resolve, 10));
        assert.equal(server.pending, 0);
      });
      assert.ok(open() <= before, `${open()} timers, before ${before}`);
    });
  }
});

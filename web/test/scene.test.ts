/** Scenes of several files: what an index says, which files are open for a view, and what arrives of them. */

import assert from "node:assert/strict";
import { readdirSync } from "node:fs";
import { join } from "node:path";
import { describe, it } from "node:test";
import { openScar } from "../../conformance/decoders/js/decoder.js";
import { inlineChannel } from "../src/decoder/channel.js";
import { createWasmDecoder } from "../src/decoder/wasm.js";
import type { Camera } from "../src/plan/types.js";
import { parseScene } from "../src/scene/document.js";
import { beside, isIndexName } from "../src/scene/index_file.js";
import { cameraIn, parsePlacement, placedBox, turned } from "../src/scene/placement.js";
import { ScarScene, type SceneOptions, type SceneTileEvent } from "../src/scene/scar_scene.js";
import { OPEN_BYTES, shares } from "../src/scene/shares.js";
import { StreamError } from "../src/stream/errors.js";
import { compiledModule, readBytes, REPOSITORY, toys } from "./files.js";
import { assertShown } from "./watching.js";

const CASES = join(REPOSITORY, "conformance/scene_index");
const bytes = toys();
const wasm = async () => createWasmDecoder(compiledModule());
const NAMES = ["EXPLICIT", "ANCHOR"];

describe("an index", () => {
  for (const name of readdirSync(join(CASES, "valid"))) {
    it(`is read: ${name}`, () => {
      const scene = parseScene(readBytes(join(CASES, "valid", name)));
      assert.ok(scene.files.length > 0 && scene.files.every(({ layers, length }) => layers.at(-1)!.end === length));
    });
  }

  for (const name of readdirSync(join(CASES, "invalid"))) {
    it(`is refused: ${name}`, () => {
      const id = name.split("--")[0];
      assert.throws(() => parseScene(readBytes(join(CASES, "invalid", name))), { id });
    });
  }

  it("names files beside it, and nothing else of its address", () => {
    const resolve = beside("https://example.org/a/b/scene.scar.json?key=1#x");
    assert.equal(resolve("north/ä b.scar"), "https://example.org/a/b/north/%C3%A4%20b.scar");
    assert.deepEqual(["x.scar.json", "x.scar", "x.JSON"].map(isIndexName), [true, false, true]);
  });
});

describe("a placement", () => {
  const rows = [
    [0, -2, 0, 5],
    [2, 0, 0, -1],
    [0, 0, 2, 0.5],
    [0, 0, 0, 1],
  ];
  const placement = parsePlacement(rows)!;
  const place = (p: [number, number, number]) => {
    const [x, y, z] = turned(placement, p);
    return [2 * x + 5, 2 * y - 1, 2 * z + 0.5];
  };

  it("takes boxes to boxes that hold all that was in them", () => {
    const box = placedBox(placement, Float64Array.of(-1, 0, 2, 4, 0.25, 9));
    for (const x of [-1, 4]) {
      for (const y of [0, 0.25]) {
        for (const z of [2, 9]) place([x, y, z]).forEach((at, i) => assert.ok(at >= box[i] - 1e-9 && at <= box[3 + i] + 1e-9));
      }
    }
  });

  it("takes cameras back to where they see the same", () => {
    const camera: Camera = { position: [1, 2, 3], forward: [1, 0, 0], up: [0, 0, 1], fovY: 1, width: 4, height: 3, velocity: [2, 0, 0] };
    const own = cameraIn(placement, camera);
    place(own.position).forEach((x, i) => assert.ok(Math.abs(x - camera.position[i]) < 1e-12));
    assert.deepEqual(turned(placement, own.forward).map(Math.round), camera.forward);
    assert.deepEqual(turned(placement, own.velocity!).map((x) => Math.round(2 * x)), camera.velocity);
    assert.equal(cameraIn(null, camera), camera);
  });
});

/** An index of copies of one file, in a row along x. */
function inRow(count: number, apart: number, change: (file: Record<string, unknown>, i: number) => void = () => {}) {
  const { container, header } = openScar(bytes);
  const side = header.voxel * 2 ** header.lattice_bits;
  const layers = container.layers.map((layer) => ({
    end: layer.end_offset,
    anchors: layer.anchor_count,
    gaussians: layer.gaussian_count,
  }));
  const files = Array.from({ length: count }, (_, i) => {
    const file = {
      uri: `part${i}.scar`,
      length: bytes.length,
      header_crc32: header.header_crc32,
      profile: NAMES[header.profile],
      sh_degree: header.sh_degree,
      slots: header.slots,
      box: [header.origin, header.origin.map((x) => x + side)],
      layers,
      transform: [
        [1, 0, 0, i * apart * side],
        [0, 1, 0, 0],
        [0, 0, 1, 0],
        [0, 0, 0, 1],
      ],
    };
    change(file, i);
    return file;
  });
  const frame = ["UNSPECIFIED", "RDF", "RUB"][header.coordinate_frame];
  const space = ["UNSPECIFIED", "SRGB", "LINEAR"][header.colour_space];
  const index = { format: "scar-scene", version: 1, coordinate_frame: frame, colour_space: space, files };
  return { text: new TextEncoder().encode(JSON.stringify(index)), side, header };
}

/** Looks along z from before a part of the row. */
function before(i: number, apart: number): Camera {
  const { side, header } = inRow(1, 0);
  const [x, y, z] = header.origin;
  const position: Camera["position"] = [x + (i * apart + 0.5) * side, y + 0.5 * side, z - 2 * side];
  return { position, forward: [0, 0, 1], up: [0, -1, 0], fovY: 0.8, width: 640, height: 480 };
}

describe("shares of files", () => {
  const { text } = inRow(6, 3);
  const { files } = parseScene(text);
  const boxes = Float64Array.from(files.flatMap(({ placement, box }) => [...placedBox(placement, box)]));
  const all = { splats: Infinity, bytes: Infinity };
  const each = files[0].layers.at(-1)!.gaussians;

  it("are those of all files where all fit, the nearest first", () => {
    const found = shares(files, boxes, before(4, 3), all, 16);
    assert.equal(found[0].file, 4);
    assert.deepEqual(found.map(({ layers }) => layers), Array(6).fill(5));
  });

  it("are all of what is looked at, and of the others what is left", () => {
    const budgets = { splats: 1.5 * each, bytes: Infinity };
    const found = shares(files, boxes, before(2, 3), budgets, 16);
    assert.deepEqual([found[0].file, found[0].layers], [2, 5]);
    assert.ok(found.length < 6 || found.some(({ layers }) => layers < 5));
    const sum = found.reduce((total, share) => total + share.budgets.splats, 0);
    assert.ok(sum <= budgets.splats * (1 + 1e-9), `${sum} Gaussians`);
  });

  it("leave files closed that no memory is left for, and those beyond the most", () => {
    assert.equal(shares(files, boxes, before(0, 3), all, 2).length, 2);
    const bytes = 2.5 * OPEN_BYTES;
    const found = shares(files, boxes, before(0, 3), { splats: Infinity, bytes }, 16);
    assert.ok(found.length >= 1 && found.length <= 2);
    assert.ok(found.reduce((total, share) => total + share.budgets.bytes, 0) <= bytes * (1 + 1e-9));
  });
});

/** A scene of which everything is followed. */
class WatchedScene {
  readonly scene: ScarScene;
  readonly shown = new Map<number, Map<number, SceneTileEvent>>();
  readonly opened: string[] = [];
  readonly errors: StreamError[] = [];
  #ends: (() => void)[] = [];

  constructor(index: Uint8Array, options: SceneOptions = {}, file: (uri: string) => Uint8Array = () => bytes) {
    this.scene = new ScarScene(new Blob([index.slice()]), {
      resolve: (uri) => {
        this.opened.push(uri);
        return new Blob([file(uri).slice()]);
      },
      workers: 0,
      channel: inlineChannel(wasm),
      replanMs: 0,
      ...options,
    });
    this.scene.on("tile", (event) => {
      const tiles = this.shown.get(event.file) ?? new Map<number, SceneTileEvent>();
      this.shown.set(event.file, tiles.set(event.tile, event));
    });
    this.scene.on("evict", ({ file, tile }) => assert.ok(this.shown.get(file)?.delete(tile), "it was shown"));
    this.scene.on("error", (error) => {
      this.errors.push(error);
      if (error.fatal) this.#end();
    });
    this.scene.on("done", () => this.#end());
  }

  async end(): Promise<void> {
    await new Promise<void>((resolve) => this.#ends.push(resolve));
  }

  /** Files of which something is shown. */
  get files(): number[] {
    return [...this.shown].filter(([, tiles]) => tiles.size > 0).map(([file]) => file).toSorted((a, b) => a - b);
  }

  #end(): void {
    for (const resolve of this.#ends.splice(0)) resolve();
  }
}

describe("a scene", () => {
  it("is all tiles of all its files where they fit", async () => {
    const watched = new WatchedScene(inRow(3, 4).text, { camera: before(1, 4) });
    const front = await watched.scene.ready;
    await watched.end();
    assert.deepEqual([front.index.tiles, front.total], [3, 3 * 10914]);
    assert.equal(watched.opened[0], "part1.scar", "what is looked at comes first");
    assert.deepEqual(watched.files, [0, 1, 2]);
    for (const tiles of watched.shown.values()) {
      assert.equal(tiles.size, 24);
      await assertShown(tiles, bytes, wasm);
      for (const { layer } of tiles.values()) assert.equal(layer, 5);
    }
    const stats = watched.scene.stats();
    assert.deepEqual([stats.splatsShown, stats.tilesAtLayer], [3 * 10914, [3, 3, 3, 3, 3]]);
    assert.deepEqual(watched.errors, []);
    watched.scene.close();
  });

  it("opens no file that is far away before there is room, and another when the view goes there", async () => {
    const budgets = { splats: 15_000 };
    const watched = new WatchedScene(inRow(4, 40).text, { camera: before(0, 40), budgets });
    watched.scene.on("tile", () => assert.ok(watched.scene.stats().splatsShown <= budgets.splats));
    await watched.end();
    assert.deepEqual([...watched.shown.get(0)!.values()].map(({ layer }) => layer), Array(24).fill(5));
    assert.equal(watched.opened.includes("part3.scar"), false);
    watched.scene.setView(before(3, 40));
    for (let i = 0; i < 100 && (watched.shown.get(3)?.size ?? 0) < 24; i++) await watched.end();
    assert.deepEqual([...watched.shown.get(3)!.values()].map(({ layer }) => layer), Array(24).fill(5));
    await assertShown(watched.shown.get(3)!, bytes, wasm);
    assert.ok((watched.shown.get(0)?.size ?? 0) < 24, "what it showed before made room");
    watched.scene.close();
  });

  it("goes on without a file that is not the one that was listed", async () => {
    const other = (file: Record<string, unknown>, i: number) => i === 1 && (file["header_crc32"] = 7);
    const watched = new WatchedScene(inRow(3, 1, other).text, { camera: before(1, 1) });
    await watched.end();
    assert.deepEqual(watched.errors.map(({ id, fatal }) => [id, fatal]), [["scene-file", false]]);
    assert.deepEqual(watched.files, [0, 2]);
    watched.scene.close();
  });

  it("goes on without a file that is damaged or missing, and has it when it is asked to try again", async () => {
    let mended = false;
    const file = (uri: string) => (uri === "part0.scar" && !mended ? new Uint8Array(99) : bytes);
    const watched = new WatchedScene(inRow(2, 1).text, { camera: before(0, 1) }, file);
    await watched.end();
    assert.deepEqual(watched.errors.map(({ id, fatal }) => [id, fatal]), [["bad-signature", false]]);
    assert.deepEqual(watched.files, [1]);
    mended = true;
    watched.scene.resume();
    await watched.end();
    assert.deepEqual(watched.files, [0, 1]);
    watched.scene.close();
  });

  it("goes on without a file that is not to be had", async () => {
    const resolve = (uri: string) => {
      if (uri === "part0.scar") throw new StreamError("bad-source", "not there");
      return new Blob([bytes.slice()]);
    };
    const watched = new WatchedScene(inRow(2, 1).text, { resolve });
    await watched.end();
    assert.deepEqual(watched.errors.map(({ id, source, fatal }) => [id, source, fatal]), [["bad-source", null, false]]);
    assert.deepEqual(watched.files, [1]);
    watched.scene.close();
  });

  it("ends where its index is refused", async () => {
    const watched = new WatchedScene(new TextEncoder().encode('{"format": "scar"}'));
    await assert.rejects(watched.scene.ready, { id: "bad-scene" });
    assert.deepEqual(watched.errors.map(({ id, fatal }) => [id, fatal]), [["bad-scene", true]]);
  });

  it("is silent once it is closed", async () => {
    const watched = new WatchedScene(inRow(3, 1).text);
    await new Promise<void>((resolve) => watched.scene.on("tile", () => resolve()));
    watched.scene.close();
    const count = watched.files.length;
    await new Promise((resolve) => setTimeout(resolve, 150));
    assert.equal(watched.files.length, count);
  });
});

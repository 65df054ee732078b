/** Following a stream to its end, and comparing what it delivered with a direct decode. */

import assert from "node:assert/strict";
import { createJsDecoder } from "../src/decoder/js.js";
import type { MakeDecoder, TileValues } from "../src/decoder/types.js";
import type { StreamError } from "../src/stream/errors.js";
import { ScarStream, type Stats, type StreamOptions, type TileEvent } from "../src/stream/scar_stream.js";
import type { SourceLike } from "../src/stream/source.js";
import { Feeder } from "./feeding.js";

/** A stream with what it told so far. */
export class Watched {
  readonly stream: ScarStream;
  readonly shown = new Map<number, TileEvent>();
  readonly tiles: TileEvent[] = [];
  readonly errors: StreamError[] = [];
  readonly retries: StreamError[] = [];
  evicted = 0;
  readonly #ends: (() => void)[] = [];
  #ended = false;

  constructor(source: SourceLike, options: StreamOptions = {}) {
    this.stream = new ScarStream(source, { workers: 0, retry: { firstMs: 5, mostMs: 20 }, ...options });
    this.stream.on("tile", (event) => {
      this.tiles.push(event);
      this.shown.set(event.tile, event);
    });
    this.stream.on("evict", ({ tile }) => {
      this.evicted++;
      this.shown.delete(tile);
    });
    this.stream.on("error", (error) => {
      this.errors.push(error);
      if (error.fatal) this.#end();
    });
    this.stream.on("retry", ({ error }) => this.retries.push(error));
    this.stream.on("done", () => this.#end());
  }

  /** Waits for "done", or a fatal error. */
  async end(): Promise<Stats> {
    if (!this.#ended) await new Promise<void>((resolve) => this.#ends.push(resolve));
    this.#ended = false;
    return this.stream.stats();
  }

  #end(): void {
    this.#ended = true;
    for (const resolve of this.#ends.splice(0)) resolve();
  }
}

/** Runs with a watched stream, which is closed whatever happens. */
export async function watching(
  source: SourceLike,
  options: StreamOptions,
  run: (watched: Watched) => Promise<void>,
): Promise<void> {
  const watched = new Watched(source, options);
  try {
    await run(watched);
  } finally {
    watched.stream.close();
  }
}

const NAMES = ["centres", "scales", "quats", "opacity", "sh"] as const;

/** Direct decodes by file, then decoder, tile and layer. */
const decodes = new Map<Uint8Array, Map<string, TileValues>>();

async function direct(bytes: Uint8Array, tile: number, layer: number, make: MakeDecoder): Promise<TileValues> {
  const ofFile = decodes.get(bytes) ?? new Map<string, TileValues>();
  decodes.set(bytes, ofFile);
  const name = (one: number) => `${make.name} ${one} ${layer}`;
  if (!ofFile.has(name(tile))) {
    const feeder = new Feeder(await make(), bytes);
    for (let k = 1; k <= feeder.layers; k++) feeder.addModels(k);
    for (let t = 0; t < feeder.tiles; t++) {
      for (let k = 1; k <= layer; k++) feeder.advance(t, k);
      ofFile.set(name(t), feeder.decoder.values(t));
      feeder.decoder.release(t);
    }
  }
  return ofFile.get(name(tile))!;
}

/** What is shown of each tile is, bit for bit, a direct decode to its layer. */
export async function assertShown(
  shown: Map<number, Pick<TileEvent, "layer" | "count" | "output">>,
  bytes: Uint8Array,
  make: MakeDecoder = createJsDecoder,
): Promise<void> {
  for (const [tile, { layer, count, output }] of shown) {
    const wanted = await direct(bytes, tile, layer, make);
    assert.equal(count, wanted.count);
    for (const name of NAMES) {
      const same = Buffer.compare(bytesOf((output as TileValues)[name]), bytesOf(wanted[name])) === 0;
      assert.ok(same, `${name} of tile ${tile} after layer ${layer}`);
    }
  }
}

function bytesOf({ buffer, byteOffset, byteLength }: Float32Array): Uint8Array {
  return new Uint8Array(buffer, byteOffset, byteLength);
}

/** Every tile that has anchors is shown after the last layer, as a direct decode gives it. */
export async function assertComplete(
  { shown, stream }: Watched,
  bytes: Uint8Array,
  make: MakeDecoder = createJsDecoder,
): Promise<void> {
  const { index } = stream.front!;
  assert.equal(shown.size, index.tiles);
  for (const { layer } of shown.values()) assert.equal(layer, index.layers);
  await assertShown(shown, bytes, make);
}

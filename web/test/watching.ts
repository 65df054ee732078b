/** Following a stream to its end, and comparing what it delivered with a direct decode. */

import assert from "node:assert/strict";
import { inlineChannel } from "../src/decoder/channel.js";
import type { TileValues } from "../src/decoder/types.js";
import type { Camera } from "../src/plan/types.js";
import type { StreamError } from "../src/stream/errors.js";
import { ScarStream, type Stats, type StreamOptions, type TileEvent } from "../src/stream/scar_stream.js";
import type { SourceLike } from "../src/stream/source.js";
import { Feeder } from "./feeding.js";
import { decoder } from "./files.js";
import { type FileServer, serving } from "./server.js";

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
    const channel = inlineChannel(async () => decoder());
    this.stream = new ScarStream(source, { workers: 0, channel, retry: { firstMs: 5, mostMs: 20 }, ...options });
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

/** Runs with a watched stream from a server that has a file, `prepare`d before the stream begins. */
export async function streaming(
  file: Uint8Array,
  { prepare, ...options }: StreamOptions & { prepare?: (server: FileServer) => void },
  run: (watched: Watched, server: FileServer, url: string) => Promise<void>,
): Promise<void> {
  await serving(file, async (url, server) => {
    prepare?.(server);
    await watching(url, options, (watched) => run(watched, server, url));
  });
}

/** A camera for planners of tests, which look at x alone. */
export function cameraAt(x: number): Camera {
  return { position: [x, 0, 0], forward: [0, 0, 1], up: [0, -1, 0], fovY: 1, width: 640, height: 480 };
}

const NAMES = ["centres", "scales", "quats", "opacity", "sh"] as const;

/** Direct decodes by file, then layer, then tile. */
const decodes = new Map<Uint8Array, Map<number, TileValues[]>>();

/** What a decoder gives of each tile after a layer. */
function direct(bytes: Uint8Array, layer: number): TileValues[] {
  const ofFile = decodes.get(bytes) ?? new Map<number, TileValues[]>();
  decodes.set(bytes, ofFile);
  if (!ofFile.has(layer)) {
    const feeder = new Feeder(bytes);
    feeder.decodeTo(layer);
    ofFile.set(layer, Array.from({ length: feeder.tiles }, (_, tile) => feeder.decoder.values(tile)));
  }
  return ofFile.get(layer)!;
}

/** What is shown of each tile is, bit for bit, a direct decode to its layer. */
export function assertShown(shown: Map<number, TileEvent>, bytes: Uint8Array): void {
  for (const [tile, { layer, count, output }] of shown) {
    const wanted = direct(bytes, layer)[tile];
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
export function assertComplete({ shown, stream }: Watched, bytes: Uint8Array): void {
  const { index } = stream.front!;
  assert.equal(shown.size, index.tiles);
  for (const { layer } of shown.values()) assert.equal(layer, index.layers);
  assertShown(shown, bytes);
}

/** Messages between a stream and its decoders, which run in workers. Each request has one reply, in order. */

import type { Block, Cube, PackedTile, Point, TileBlock, TileValues } from "./types.js";
import type { WasmDecoder } from "./wasm.js";

/** Plain arrays, or words of textures (pack/words.ts). */
export type Output = "values" | "words";

export type TileOutput = TileValues | PackedTile;

export type Task =
  | { kind: "open"; front: Uint8Array }
  | { kind: "models"; layer: number; blocks: Block[] }
  /** Takes a tile through layers, then gives its values; with no layers, gives them again. */
  | {
      kind: "tile";
      tile: number;
      cube: Cube;
      layers: TileBlock[];
      output: Output;
      eye?: Point;
      last: boolean;
    }
  | { kind: "release"; tile: number };

export type Request = Task & { id: number };

/** What a worker gets beside requests, once. */
export interface Beginning {
  module: WebAssembly.Module;
}

export interface Failure {
  message: string;
  /** Of a refusal, null for anything else. */
  id: string | null;
  offset: number | null;
  /** The layer that a tile could not be taken to. */
  layer: number | null;
}

export interface Reply {
  id: number;
  /** Bytes that the decoder holds now. */
  memory: number;
  /** Time the task took, milliseconds. */
  took: number;
  result: TileOutput | null;
  failure: Failure | null;
}

export interface Answer {
  reply: Reply;
  /** What of it may be transferred. */
  transfer: ArrayBuffer[];
}

/** Does one request. */
export function answer(decoder: WasmDecoder, request: Request): Answer {
  const started = performance.now();
  let result: TileOutput | null = null;
  let failure: Failure | null = null;
  try {
    result = run(decoder, request);
  } catch (error) {
    const { message, id, offset, layer } = error as Partial<Failure>;
    failure = { message: message ?? String(error), id: id ?? null, offset: offset ?? null, layer: layer ?? null };
  }
  const took = performance.now() - started;
  const reply = { id: request.id, memory: decoder.memory(), took, result, failure };
  return { reply, transfer: result === null ? [] : buffersOf(result) };
}

function run(decoder: WasmDecoder, task: Task): TileOutput | null {
  switch (task.kind) {
    case "open":
      decoder.open(task.front);
      return null;
    case "models":
      decoder.addModels(task.layer, task.blocks);
      return null;
    case "release":
      decoder.release(task.tile);
      return null;
    case "tile": {
      const { tile, cube, layers, output, eye, last } = task;
      for (const block of layers) advance(decoder, tile, cube, block);
      const result = output === "values" ? decoder.values(tile, eye) : decoder.packed(tile, eye);
      if (last) decoder.release(tile);
      return result;
    }
  }
}

function advance(decoder: WasmDecoder, tile: number, cube: Cube, block: TileBlock): void {
  try {
    decoder.advance(tile, cube, block);
  } catch (error) {
    throw Object.assign(error as Error, { layer: block.layer });
  }
}

/** The buffers of an output, each once. */
export function buffersOf(output: TileOutput): ArrayBuffer[] {
  const arrays = Object.values(output).filter((value): value is Float32Array<ArrayBuffer> => ArrayBuffer.isView(value));
  return [...new Set(arrays.map(({ buffer }) => buffer))];
}

/**
 * Processor time of the two decoders, in turns, on one thread: `node dist/tests/benchmark.mjs FILE.. [--runs N]`.
 *
 * Prints microseconds a Gaussian (or slot of an anchor) of decoding all layers to integers, and of the values for a
 * renderer: the least of the runs, since others are disturbed by what else the machine does.
 */

import { parseArgs } from "node:util";
import { createJsDecoder } from "../src/decoder/js.js";
import type { TileDecoder } from "../src/decoder/types.js";
import { createWasmDecoder } from "../src/decoder/wasm.js";
import { Feeder } from "./feeding.js";
import { compiledModule, readBytes } from "./files.js";

type Times = { models: number; integers: number; values: number; count: number };

/** Microseconds of processor time of something. */
function timed(run: () => void): number {
  const before = process.cpuUsage();
  run();
  const { user, system } = process.cpuUsage(before);
  return user + system;
}

function measure(decoder: TileDecoder, bytes: Uint8Array): Times {
  const feeder = new Feeder(decoder, bytes);
  const layers = [...Array(feeder.layers).keys()].map((k) => k + 1);
  const tiles = [...Array(feeder.tiles).keys()];
  const cubes = tiles.map((tile) => feeder.cube(tile));
  const blocks = tiles.map((tile) => layers.map((layer) => feeder.block(tile, layer)));
  const models = timed(() => layers.forEach((layer) => feeder.addModels(layer)));
  let [integers, values, count] = [0, 0, 0];
  for (const tile of tiles) {
    integers += timed(() => blocks[tile].forEach((block) => decoder.advance(tile, cubes[tile], block)));
    values += timed(() => (count += decoder.values(tile).count));
    decoder.release(tile);
  }
  return { models, integers, values, count };
}

const least = (runs: Times[], name: keyof Times) => Math.min(...runs.map((times) => times[name]));

async function compare(file: string, runs: number): Promise<void> {
  const bytes = readBytes(file);
  const module = compiledModule();
  const js: Times[] = [];
  const wasm: Times[] = [];
  for (let run = 0; run < runs; run++) {
    wasm.push(measure(createWasmDecoder(module), bytes));
    js.push(measure(await createJsDecoder(), bytes));
  }
  console.log(`${file}: ${js[0].count} Gaussians, ${bytes.length} bytes, least of ${runs} runs`);
  for (const name of ["models", "integers", "values"] as const) {
    const [slow, fast] = [least(js, name), least(wasm, name)];
    const each = (time: number) => `${(time / js[0].count).toFixed(3)} us`;
    const times = (slow / fast).toFixed(1);
    console.log(`  ${name.padEnd(9)} JavaScript ${each(slow)}, WebAssembly ${each(fast)}: ${times} times`);
  }
}

const { values, positionals } = parseArgs({
  allowPositionals: true,
  options: { runs: { type: "string", default: "3" } },
});
for (const file of positionals) await compare(file, Number(values.runs));

/**
 * Writes decoded values to standard output: `node dump.mjs FILE LAYERS`. For each tile the number of Gaussians (u32),
 * then centres, scales, quaternions, opacity, spherical harmonics (f32), little-endian. tests/web compares them with
 * Python's.
 */

import { writeSync } from "node:fs";
import { Feeder } from "./feeding.js";
import { readBytes } from "./files.js";

const [, , file, layers] = process.argv;
const feeder = new Feeder(readBytes(file));
feeder.decodeTo(Number(layers));
for (let tile = 0; tile < feeder.tiles; tile++) {
  const { count, centres, scales, quats, opacity, sh } = feeder.decoder.values(tile);
  for (const array of [Uint32Array.of(count), centres, scales, quats, opacity, sh]) {
    const bytes = new Uint8Array(array.buffer);
    for (let at = 0; at < bytes.length;) at += writeSync(1, bytes, at);
  }
}

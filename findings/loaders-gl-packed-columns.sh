#!/usr/bin/env bash
# loaders.gl reads the uint columns of a PLY as floats, and so rounds the packed words of a compressed PLY.
#
# One would expect: a column of `property uint` comes as a Uint32Array, or its numbers at least as they are in the file, as
#   a column of uchar does as a Uint8Array.
# What happens: columns without a meaning known to the loader become a Float32Array, which holds integers up to 2^24.
#   PlayCanvas packs a rotation, a position or a colour into 32 bits: the lowest 8 are rounded away, and nothing is said.
#   Small words are right, so a check of the first values may pass.
# Packages: @loaders.gl/core 4.5.4 and @loaders.gl/ply 4.4.5 (npm). Date: 2026-11-28.
# Why it matters: the lowest bits are a whole component: opacity of packed_color, z of packed_position. A decoder of
#   compressed PLY on top of this loader shows other opacities. Read the body of such files without it.
# Output seen:
#   packed_color 8421631 of the file: 8421631, opacity 255 of 255
#   packed_color 3229614180 of the file: 3229614080, opacity 0 of 100
#   packed_color 4294967295 of the file: 4294967296, opacity 0 of 255
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund --legacy-peer-deps @loaders.gl/core@4.5.4 @loaders.gl/ply@4.4.5 >>npm.log
cat >read.mjs <<'JS'
import { parse } from "@loaders.gl/core";
import { PLYLoader } from "@loaders.gl/ply";

// Red, green, blue and opacity, the last in the lowest byte.
const WORDS = [8421631, 3229614180, 4294967295];
const columns = ["position", "rotation", "scale", "color"].map((name) => `property uint packed_${name}`);
const head = ["ply", "format binary_little_endian 1.0", `element vertex ${WORDS.length}`, ...columns, "end_header", ""];
const rows = new Uint32Array(WORDS.flatMap((word) => [0, 0, 0, word]));
const file = Buffer.concat([Buffer.from(head.join("\n")), Buffer.from(rows.buffer)]);
const { attributes } = await parse(new Uint8Array(file).buffer, PLYLoader, { worker: false });
const found = [...attributes.packed_color.value];
WORDS.forEach((word, index) => {
  console.log(`packed_color ${word} of the file: ${found[index]}, opacity ${found[index] % 256} of ${word % 256}`);
});
process.exit(found[0] === WORDS[0] && found.every((value, index) => value === Math.fround(WORDS[index])) ? 0 : 1);
JS
node read.mjs

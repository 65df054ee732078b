#!/usr/bin/env bash
# splat-transform unpacks opaque Gaussians of a compressed PLY to an opacity of +infinity.
#
# One would expect: alpha 255 and 0 to become large finite logits, as the same tool makes them of a .splat (13.8, -13.8).
# What happens: the PLY it writes holds inf for every opaque Gaussian and -inf for every invisible one. Most of the visible
#   surface of a scene may be such Gaussians.
# Package: @playcanvas/splat-transform 3.7.0 (npm). Date: 2026-11-27.
# Why it matters: an importer that drops or refuses values that are not finite loses the opaque part of a scene. The values
#   are meant: inf is opaque.
# Output seen:
#   splat-transform v3.7.0 (0f60b17)
#   .splat to PLY: opacity 13.8155 and -13.8155
#   .splat to compressed PLY to PLY: opacity inf and -inf
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @playcanvas/splat-transform@3.7.0 >>npm.log
npx splat-transform --version
python3 - <<'PY'
import struct

rows = [struct.pack("<6f8B", k, 0, 0, 0.1, 0.1, 0.1, 9, 99, 199, alpha, 255, 128, 128, 128) for k, alpha in enumerate((255, 0))]
open("in.splat", "wb").write(b"".join(rows))
PY
npx splat-transform --quiet in.splat direct.ply
npx splat-transform --quiet in.splat packed.compressed.ply
npx splat-transform --quiet packed.compressed.ply unpacked.ply
python3 - <<'PY'
import math
import struct
import sys


def opacities(name):
    head, _, body = open(name, "rb").read().partition(b"end_header\n")
    names = [line.split()[2] for line in head.decode().splitlines() if line.startswith("property float")]
    rows = [struct.unpack_from(f"<{len(names)}f", body, 4 * len(names) * k) for k in range(2)]
    return sorted((row[names.index("opacity")] for row in rows), reverse=True)


direct, unpacked = opacities("direct.ply"), opacities("unpacked.ply")
print(f".splat to PLY: opacity {direct[0]:.6g} and {direct[1]:.6g}")
print(f".splat to compressed PLY to PLY: opacity {unpacked[0]} and {unpacked[1]}")
sys.exit(not (all(map(math.isfinite, direct)) and unpacked == [math.inf, -math.inf]))
PY

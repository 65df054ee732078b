#!/usr/bin/env bash
# splat-transform cuts opacities down to the byte below when it writes SOG.
#
# One would expect: opacity times 255, rounded, as in its SPZ and compressed PLY: 255 for an opaque Gaussian.
# What happens: the byte is the integer part. An opacity of 13.8 as a logit (0.999999) becomes 254, and half of
#   the bytes that came from a SOG, SPZ or .splat are one less when they are written again: k/255 * 255 rounds below k.
# Package: @playcanvas/splat-transform 3.7.0 (npm). Date: 2026-11-27.
# Why it matters: every conversion makes a scene fainter by half a step on average; opaque surfaces are never opaque again,
#   and a comparison of opacities by equality fails.
# Output seen:
#   splat-transform v3.7.0 (0f60b17)
#   opacity logit 13.8155: SPZ 255, SOG 254
#   opacities k/255 written for k = 1 to 254: 0 differ in SPZ, 127 in SOG, all of them lower by 1
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet pillow
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @playcanvas/splat-transform@3.7.0 >>npm.log
npx splat-transform --version
python3 - <<'PY'
import math
import struct

names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split()
head = "ply\nformat binary_little_endian 1.0\nelement vertex 255\n" + "".join(f"property float {n}\n" for n in names)
logits = [math.log(k / (255 - k)) for k in range(1, 255)] + [13.8155]
rows = [struct.pack("<14f", k, 0, 0, 0, 0, 0, logit, -3, -3, -3, 1, 0, 0, 0) for k, logit in enumerate(logits)]
open("in.ply", "wb").write((head + "end_header\n").encode() + b"".join(rows))
PY
npx splat-transform --quiet --gpu cpu --spz-version 3 in.ply out.spz
npx splat-transform --quiet --gpu cpu in.ply out.sog
venv/bin/python - <<'PY'
import gzip
import io
import sys
import zipfile

from PIL import Image

data = gzip.decompress(open("out.spz", "rb").read())
spz = sorted(data[16 + 9 * 255 : 16 + 10 * 255])
with zipfile.ZipFile("out.sog") as archive:
    pixels = Image.open(io.BytesIO(archive.read("sh0.webp"))).convert("RGBA").getchannel("A").tobytes()
sog = sorted(pixels[:255])
print(f"opacity logit 13.8155: SPZ {spz[-1]}, SOG {sog[-1]}")
wanted = list(range(1, 255))
off = [a - b for a, b in zip(sog[:-1], wanted)]
lower = sum(x == -1 for x in off)
print(f"opacities k/255 written for k = 1 to 254: {sum(a != b for a, b in zip(spz, wanted))} differ in SPZ, "
      f"{sum(x != 0 for x in off)} in SOG, all of them lower by 1" * (lower == sum(x != 0 for x in off)))
sys.exit(not (spz[-1] == 255 and sog[-1] == 254 and lower > 100 and spz[:-1] == wanted))
PY

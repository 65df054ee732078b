#!/usr/bin/env bash
# Pillow resizes a depth map of 16 bits right, and turns, warps, pastes and averages its bytes.
#
# One would expect: what resize does for a picture of mode "I;16", the mode of a 16-bit PNG, to hold for its other operations, or an
#   error, as filter, blend and autocontrast raise.
# What happens: rotate and transform that interpolate take each byte for a pixel; so do masks of paste and composite, which
#   reach the left half alone, and ImageStat. resize itself mixes bytes where they are swapped, as in a TIFF from a big-endian
#   program ("I;16B"). Floats that are converted to "I;16" are cut at 255, though by way of "I" they are not. Type and size of
#   the results are right, and nothing is said. In modes "I" and "F" all are right.
# Package: Pillow 13.0.0 (PyPI). Date: 2026-11-30.
# Why it matters: depth of phones and depth cameras is millimetres in 16 bits. It is levelled and warped to fit the photograph, and
#   masked; what comes out is noise below 256 mm, or has a mask on one side, and trains as surfaces before the camera. Convert
#   to "F" or "I" first, and to "I;16" by way of "I".
# Output seen (the middle row of a wall, 8 pixels wide, at 1000 mm, with a floor at 2000 mm where it is pasted on):
#   resize: 1000 1000 1000 1000 1000 1000 1000 1000
#   rotate by 1 degree, nearest: 1000 1000 1000 1000 1000 1000 1000 1000
#   rotate by 1 degree, bilinear: 232 4 230 4 229 5 229 5
#   moved by a quarter of a pixel: 174 60 174 60 174 60 174 3
#   pasted on 2000 by a mask of 255: 1000 1000 1000 1000 2000 2000 2000 2000
#   mean by ImageStat: 117.5
#   floats to I;16: 255 255 255 255 255 255 255 255
#   floats to I to I;16: 1000 1000 1000 1000 1000 1000 1000 1000
#   rotate of mode F: 1000 1000 1000 1000 1000 1000 1000 1000
#   slope of 240 to 268, resized to half: I;16 243 250 258 265, I;16B 56306 218 290 9737
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet pillow==13.0.0 numpy 2>pip.log
tools/bin/python - <<'PY' | tee seen
import numpy as np
from PIL import Image, ImageStat

SIZE = (8, 8)
QUARTER = (1, 0, 0.25, 0, 1, 0)


def tell(title, picture):
    row = np.asarray(picture)[picture.height // 2]
    print(f"{title}: {' '.join(f'{number:g}' for number in row)}")


wall = Image.fromarray(np.full(SIZE, 1000, np.uint16))
floats = Image.fromarray(np.full(SIZE, 1000, np.float32))
tell("resize", wall.resize(SIZE, Image.BILINEAR, box=(0.5, 0.5, 7.5, 7.5)))
tell("rotate by 1 degree, nearest", wall.rotate(1))
tell("rotate by 1 degree, bilinear", wall.rotate(1, Image.BILINEAR))
tell("moved by a quarter of a pixel", wall.transform(SIZE, Image.AFFINE, QUARTER, Image.BILINEAR))
floor = Image.fromarray(np.full(SIZE, 2000, np.uint16))
floor.paste(wall, (0, 0), Image.new("L", SIZE, 255))
tell("pasted on 2000 by a mask of 255", floor)
print(f"mean by ImageStat: {ImageStat.Stat(wall).mean[0]}")
tell("floats to I;16", floats.convert("I;16"))
tell("floats to I to I;16", floats.convert("I").convert("I;16"))
tell("rotate of mode F", floats.rotate(1, Image.BILINEAR))
slope = np.tile(np.arange(240, 272, 4, dtype=np.uint16), (8, 1))
halves = []
for kind in ("<u2", ">u2"):
    picture = Image.fromarray(slope.astype(kind))
    half = np.asarray(picture.resize((4, 4), Image.BILINEAR))[2]
    halves.append(f"{picture.mode} {' '.join(map(str, half))}")
print(f"slope of 240 to 268, resized to half: {', '.join(halves)}")
PY
diff seen - <<'END'
resize: 1000 1000 1000 1000 1000 1000 1000 1000
rotate by 1 degree, nearest: 1000 1000 1000 1000 1000 1000 1000 1000
rotate by 1 degree, bilinear: 232 4 230 4 229 5 229 5
moved by a quarter of a pixel: 174 60 174 60 174 60 174 3
pasted on 2000 by a mask of 255: 1000 1000 1000 1000 2000 2000 2000 2000
mean by ImageStat: 117.5
floats to I;16: 255 255 255 255 255 255 255 255
floats to I to I;16: 1000 1000 1000 1000 1000 1000 1000 1000
rotate of mode F: 1000 1000 1000 1000 1000 1000 1000 1000
slope of 240 to 268, resized to half: I;16 243 250 258 265, I;16B 56306 218 290 9737
END

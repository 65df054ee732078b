#!/usr/bin/env bash
# pycolmap writes text models that it does not read back: names end at a space, and a last image can be lost.
#
# One would expect: a model written by Reconstruction.write_text and read by read_text to be the same, and an images.txt
#   without the empty line after its last image to hold that image.
# What happens: `photo 1.jpg` is written as it is and read as `photo`, so two photos have one name; nothing is said. Binary
#   models keep the names. Where the file ends after an image's line, as after any editor or exporter that strips empty
#   lines at the end, that image is dropped without a word.
# Package: pycolmap 4.2.1 (PyPI). Date: 2026-11-28.
# Why it matters: RealityScan and phones name photos so. Trainers that match names to files lose them all, or take one
#   photo for another's pose; a capture that went through text has a camera less. Convert by binary files alone.
# Output seen:
#   names written: photo 1.jpg, photo 2.jpg
#   names from binary: photo 1.jpg, photo 2.jpg
#   names from text: photo, photo
#   names without the last empty line: photo
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet pycolmap==4.2.1 2>pip.log
tools/bin/python - <<'PY'
import sys
from pathlib import Path

import pycolmap

model = Path("model")
model.mkdir()
(model / "cameras.txt").write_text("1 PINHOLE 640 480 500 500 320 240\n")
(model / "images.txt").write_text("1 1 0 0 0 0 0 0 1 first\n\n2 1 0 0 0 1 0 0 1 second\n\n")
(model / "points3D.txt").write_text("")


def names(reconstruction):
    return ", ".join(image.name for _, image in sorted(reconstruction.images.items()))


def read(kind):
    reconstruction = pycolmap.Reconstruction()
    getattr(reconstruction, f"read_{kind}")(str(model))
    return names(reconstruction)


made = pycolmap.Reconstruction(str(model))
for number, image in made.images.items():
    image.name = f"photo {number}.jpg"
made.write_binary(str(model))
made.write_text(str(model))
binary, text = read("binary"), read("text")
listing = model / "images.txt"
listing.write_text(listing.read_text().rstrip("\n"))
cut = read("text")
print(f"names written: {names(made)}\nnames from binary: {binary}\nnames from text: {text}")
print(f"names without the last empty line: {cut}")
sys.exit((binary, text, cut) != ("photo 1.jpg, photo 2.jpg", "photo, photo", "photo"))
PY

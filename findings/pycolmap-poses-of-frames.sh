#!/usr/bin/env bash
# pycolmap reads no pose from images.txt where a frames.txt lies beside it: what a tool changed there is lost.
#
# One would expect: poses of images.txt and images.bin, which all programs read, are those of the model, or a model whose
#   files contradict each other is refused.
# What happens: since rigs came, pycolmap writes each pose twice, into the images and into the frames. It reads them from the
#   frames alone. Other numbers in the images are passed over without a word. Of a model whose frames were deleted with
#   the rigs left, it raises IndexError; of one that never had any of both, it takes the images' poses.
# Package: pycolmap 4.2.1 (PyPI). Date: 2026-11-29.
# Why it matters: scripts that align, scale or pick cameras know cameras, images and points3D. Points move and cameras stay
#   as far as COLMAP goes, while INRIA's trainer and its kin take the images: the same folder holds two captures. Delete
#   rigs and frames, both, with every change of the images.
# Output seen (x of a camera's translation, 1 when written, 9 after a change of images):
#   text: with rigs and frames 1, without frames IndexError, without both 9
#   binary: with rigs and frames 1, without frames IndexError, without both 9
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet pycolmap==4.2.1 2>pip.log
tools/bin/python - <<'PY'
import struct
import sys
from pathlib import Path

import pycolmap

model = Path("model")


def write(kind):
    """A model of one photo at x = 1, whose images then say 9."""
    for file in model.glob("*.*"):
        file.unlink()
    model.mkdir(exist_ok=True)
    (model / "cameras.txt").write_text("1 PINHOLE 640 480 500 500 320 240\n")
    (model / "images.txt").write_text("1 1 0 0 0 1 0 0 1 photo.jpg\n\n")
    (model / "points3D.txt").write_text("")
    made = pycolmap.Reconstruction(str(model))
    getattr(made, f"write_{kind}")(str(model))
    if kind == "text":
        images = model / "images.txt"
        images.write_text(images.read_text().replace("1 1 0 0 0 1 0 0 1 photo", "1 1 0 0 0 9 0 0 1 photo"))
    else:
        images = model / "images.bin"
        content = bytearray(images.read_bytes())
        # The number of images, an id, the quaternion, and then the translation.
        struct.pack_into("<d", content, 8 + 4 + 4 * 8, 9.0)
        images.write_bytes(content)


def read(kind, *dropped):
    for name in dropped:
        for file in model.glob(f"{name}.*"):
            file.unlink()
    reconstruction = pycolmap.Reconstruction()
    try:
        getattr(reconstruction, f"read_{kind}")(str(model))
    except IndexError as error:
        return type(error).__name__
    return f"{reconstruction.images[1].cam_from_world().translation[0]:g}"


found = []
for kind in ("text", "binary"):
    write(kind)
    found.append([read(kind), read(kind, "frames"), read(kind, "rigs")])
    print(f"{kind}: with rigs and frames {found[-1][0]}, without frames {found[-1][1]}, without both {found[-1][2]}")
sys.exit(found != 2 * [["1", "IndexError", "9"]])
PY

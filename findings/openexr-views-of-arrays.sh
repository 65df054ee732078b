#!/usr/bin/env bash
# OpenEXR writes the memory behind a NumPy view: one channel of a picture, a crop or a transposed tensor becomes another picture.
#
# One would expect: {"R": image[..., 0], ...} to write the red of the picture, as for every library that takes arrays, or to be
#   refused, as arrays of other types are.
# What happens: as many numbers as the view has are taken in a row from its address. A channel of an interleaved picture begins
#   with red, green and blue of the first pixels; a tensor of channels, rows, columns that was transposed keeps its old order; a crop
#   is filled by the first rows, wrapped round. Size, names and type are right, and nothing is said. Whole rows are right.
# Package: OpenEXR 3.5.3 (PyPI; 3.3.0 and 3.4.4 do the same). Date: 2026-11-30.
# Why it matters: depth, normals and linear renders of scenes are kept in EXR. Renderers give tensors, and multi-channel files are
#   made channel by channel, so a view is what one has. Call np.ascontiguousarray on each before.
# Output seen (which of the pictures come back as they were):
#   contiguous: as RGB right, channel by channel wrong
#   whole rows: as RGB right, channel by channel wrong
#   a tensor of channels, transposed: as RGB wrong, channel by channel right
#   left half: as RGB wrong, channel by channel wrong
#   left half, np.ascontiguousarray: as RGB right, channel by channel right
#   depth, transposed: wrong
#   red of the first row, 0 3 6 9 12 15 in the picture and written as a channel: 0 1 2 3 4 5
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet OpenEXR==3.5.3 numpy 2>pip.log
tools/bin/python - <<'PY' | tee seen
import numpy as np
import OpenEXR

HEIGHT, WIDTH = 4, 6


def read_back(channels):
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, channels) as file:
        file.write("picture.exr")
    with OpenEXR.File("picture.exr") as file:
        return {name: channel.pixels for name, channel in file.channels().items()}


def judge(name, read, given):
    return "right" if np.array_equal(read[name], given) else "wrong"


def split(picture, make):
    return {name: make(picture[..., index]) for index, name in enumerate("RGB")}


wide = np.arange(HEIGHT * 2 * WIDTH * 3, dtype=np.float32).reshape(HEIGHT, 2 * WIDTH, 3)
picture = np.arange(HEIGHT * WIDTH * 3, dtype=np.float32).reshape(HEIGHT, WIDTH, 3)
tensor = np.ascontiguousarray(picture.transpose(2, 0, 1))
as_it_is = lambda array: array
for title, view, make in [
    ("contiguous", picture, as_it_is),
    ("whole rows", picture[1:3], as_it_is),
    ("a tensor of channels, transposed", tensor.transpose(1, 2, 0), as_it_is),
    ("left half", wide[:, :WIDTH], as_it_is),
    ("left half, np.ascontiguousarray", wide[:, :WIDTH], np.ascontiguousarray),
]:
    whole, parts = read_back({"RGB": make(view)}), read_back(split(view, make))
    print(f"{title}: as RGB {judge('RGB', whole, view)}, channel by channel {judge('RGB', parts, view)}")
depth = tensor[0].T
print(f"depth, transposed: {judge('Z', read_back({'Z': depth}), depth)}")
show = lambda row: " ".join(f"{number:g}" for number in row)
written = read_back(split(picture, as_it_is))["RGB"][0, :, 0]
print(f"red of the first row, {show(picture[0, :, 0])} in the picture and written as a channel: {show(written)}")
PY
diff seen - <<'END'
contiguous: as RGB right, channel by channel wrong
whole rows: as RGB right, channel by channel wrong
a tensor of channels, transposed: as RGB wrong, channel by channel right
left half: as RGB wrong, channel by channel wrong
left half, np.ascontiguousarray: as RGB right, channel by channel right
depth, transposed: wrong
red of the first row, 0 3 6 9 12 15 in the picture and written as a channel: 0 1 2 3 4 5
END

#!/usr/bin/env bash
# laspy appends points to a LAS by their integers: points of another scale or offset land elsewhere.
#
# One would expect: append_points to take points that know their scale and offset to the places where they are, as write_points of
#   a new file does, which rescales them; or to refuse them.
# What happens: the integers are copied under the scale and offset of the file. Points in millimetres behind a file in centimetres
#   lie ten times as far from the offset. Nothing is said, and the bounds of the header are those of the wrong places.
#   The number and the format of the points are right, and a file whose scale agrees comes out right.
# Packages: laspy 2.7.0 and lazrs 0.8.2 (PyPI). Date: 2026-11-30.
# Why it matters: tiles of one site may have offsets of their own, and scanners other scales. A cloud for a training that is
#   gathered tile by tile gets the first right, and the others beside it. Call change_scaling first.
# Output seen (x y z of a point of the tile, in a new file by write_points, and appended):
#   same scale and offset: 501001 5200020 30, new 501001 5200020 30, appended 501001 5200020 30; largest x of the header 501001
#   millimetres: 501001 5200020 30, new 501001 5200020 30, appended 510010 5200200 300; largest x of the header 510010
#   offset of the next tile: 501001 5200020 30, new 501001 5200020 30, appended 500001 5200020 30; largest x of the header 500001
#   offset of the next tile, LAZ: 501001 5200020 30, new 501001 5200020 30, appended 500001 5200020 30; largest x of the header
#     500001
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet laspy==2.7.0 lazrs==0.8.2 numpy==2.4.6 2>pip.log
tools/bin/python - <<'PY'
import sys

import laspy
import numpy as np


def make_tile(scale, offset, place):
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales, header.offsets = np.full(3, scale), np.array(offset)
    tile = laspy.LasData(header)
    tile.xyz = np.array([place])
    return tile


as_told = True
for title, suffix, scale, offset in (
    ("same scale and offset", "las", 0.01, [500000.0, 5200000.0, 0.0]),
    ("millimetres", "las", 0.001, [500000.0, 5200000.0, 0.0]),
    ("offset of the next tile", "las", 0.01, [501000.0, 5200000.0, 0.0]),
    ("offset of the next tile, LAZ", "laz", 0.01, [501000.0, 5200000.0, 0.0]),
):
    first = make_tile(0.01, [500000.0, 5200000.0, 0.0], [500001.0, 5200002.0, 3.0])
    second = make_tile(scale, offset, [501001.0, 5200020.0, 30.0])
    first.write(f"appended.{suffix}")
    with laspy.open(f"new.{suffix}", mode="w", header=first.header) as writer:
        writer.write_points(second.points)
    with laspy.open(f"appended.{suffix}", mode="a") as appender:
        appender.append_points(second.points)
    appended = laspy.read(f"appended.{suffix}")
    places = [second.xyz[0], laspy.read(f"new.{suffix}").xyz[0], appended.xyz[1]]
    texts = [" ".join(f"{number:.0f}" for number in place) for place in places]
    print(f"{title}: {texts[0]}, new {texts[1]}, appended {texts[2]}; largest x of the header {appended.header.maxs[0]:.0f}")
    as_told &= bool(np.allclose(places[0], places[1]) and np.allclose(places[0], places[2]) == title.startswith("same"))
sys.exit(not as_told)
PY

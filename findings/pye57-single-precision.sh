#!/usr/bin/env bash
# pye57 writes positions in single precision and returns them as doubles: map coordinates move by decimetres.
#
# One would expect: doubles that are handed to write_scan_raw to be written as such. E57 has both precisions, and surveys need
#   the greater one.
# What happens: every coordinate is a float of 4 bytes in the file. No argument chooses; nothing is said; read_scan gives an
#   array of float64 that looks exact. At a northing of 5,200,000 m neighbours that differ are 0.5 m apart, at 500,000 m 0.03 m.
# Packages: pye57 0.4.19 and laspy 2.7.0 (PyPI). Date: 2026-11-30.
# Why it matters: a scan that goes from LAS, which keeps millimetres, to E57 for training or registration loses its shape along
#   the larger coordinate: walls become planes half a metre apart. Subtract an offset first, and give it as the scan's
#   translation, which is kept as double.
# Output seen (largest error in metres, and number of distinct values, of 1,000 points in a room of 4 m):
#   LAS: x 0.000 of 891, y 0.000 of 891
#   E57 of map coordinates: x 0.015 of 129, y 0.250 of 9
#   E57 with an offset as translation: x 0.000 of 891, y 0.000 of 891
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet pye57==0.4.19 laspy==2.7.0 numpy 2>pip.log
tools/bin/python - <<'PY'
import sys

import laspy
import numpy as np
import pye57

OFFSET = np.array([500_000.0, 5_200_000.0, 300.0])
room = np.random.default_rng(0).integers(0, 4000, (1000, 3)) / 1000
points = room + OFFSET


def say(title, read):
    errors, counts = np.abs(read - points).max(axis=0), [len(np.unique(column)) for column in read.T]
    print(f"{title}: x {errors[0]:.3f} of {counts[0]}, y {errors[1]:.3f} of {counts[1]}")
    return errors[:2]


def write_and_read(name, places, translation):
    file = pye57.E57(name, mode="w")
    columns = dict(zip(("cartesianX", "cartesianY", "cartesianZ"), places.T.copy()))
    file.write_scan_raw(columns, rotation=np.array([1.0, 0, 0, 0]), translation=translation)
    file.close()
    scan = pye57.E57(name).read_scan(0, ignore_missing_fields=True)
    read = np.stack([scan[column] for column in columns], axis=1)
    assert read.dtype == np.float64
    return read


header = laspy.LasHeader(point_format=0)
header.scales, header.offsets = [0.001] * 3, OFFSET
las = laspy.LasData(header)
las.xyz = points
las.write("room.las")
kept = say("LAS", np.asarray(laspy.read("room.las").xyz))
lost = say("E57 of map coordinates", write_and_read("map.e57", points, np.zeros(3)))
moved = say("E57 with an offset as translation", write_and_read("offset.e57", room, OFFSET))
sys.exit(not (kept.max() < 0.001 and moved.max() < 0.001 and lost[0] > 0.01 and lost[1] > 0.2))
PY

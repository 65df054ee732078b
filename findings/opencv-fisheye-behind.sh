#!/usr/bin/env bash
# OpenCV's fisheye camera shows what lies beyond 90 degrees on the opposite side of the image.
#
# One would expect: a fisheye model, which is one of angles, to put a point at 95 degrees from the axis farther out than one at
#   85, up to 180; or to say that it cannot, as COLMAP's camera of the same parameters does.
# What happens: cv2.fisheye.projectPoints takes the angle from x/z and y/z, so a point behind the camera has the angle of its
#   mirror image in front: at 95 degrees it lies where one at 85 on the other side does, at 170 near the centre.
#   pycolmap gives None from 90 degrees on.
# Packages: opencv-python-headless 5.0.0.93 and pycolmap 4.2.1 (PyPI). Date: 2026-11-29.
# Why it matters: cameras of 190 degrees are usual for captures of rooms, and scenes surround a camera. Gaussians behind it fall
#   into masks, counts of visibility and depth maps. Drop points of z below 0 before, or take a model of angles from atan2.
# Output seen:
#   30 degrees: OpenCV 708.9 500.0, COLMAP 708.9 500.0
#   85 degrees: OpenCV 1086.1 500.0, COLMAP 1086.1 500.0
#   95 degrees: OpenCV -86.1 500.0, COLMAP none
#   170 degrees: OpenCV 430.2 500.0, COLMAP none
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet opencv-python-headless==5.0.0.93 pycolmap==4.2.1 numpy 2>pip.log
tools/bin/python - <<'PY'
import sys

import cv2
import numpy as np
import pycolmap

FOCAL, CENTRE, DISTORTION = 400.0, 500.0, np.array([-0.01, 0.002, 0, 0])
matrix = np.array([[FOCAL, 0, CENTRE], [0, FOCAL, CENTRE], [0, 0, 1]])
camera = pycolmap.Camera(model="OPENCV_FISHEYE", width=1000, height=1000, params=[FOCAL, FOCAL, CENTRE, CENTRE, *DISTORTION])
found = []
for degrees in (30, 85, 95, 170):
    angle = np.radians(degrees)
    point = 3 * np.array([np.sin(angle), 0, np.cos(angle)])
    opencv = cv2.fisheye.projectPoints(point.reshape(1, 1, 3), np.zeros(3), np.zeros(3), matrix, DISTORTION)[0].ravel()
    colmap = camera.img_from_cam(point)
    told = "none" if colmap is None else " ".join(f"{value:.1f}" for value in colmap)
    print(f"{degrees} degrees: OpenCV {opencv[0]:.1f} {opencv[1]:.1f}, COLMAP {told}")
    found.append((opencv[0], colmap))
front, wide, behind, back = (place for place, _ in found)
mirrored = np.isclose(behind - CENTRE, CENTRE - wide, atol=0.1) and 0 < CENTRE - back < 100
sys.exit(not (mirrored and np.isclose(front, found[0][1][0]) and found[2][1] is None and found[3][1] is None))
PY

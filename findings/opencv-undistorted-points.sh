#!/usr/bin/env bash
# OpenCV's undistortPoints stops after five steps: in the corners of a wide photograph points are dozens of pixels off.
#
# One would expect: the reverse of projectPoints, as its documentation says, to a small part of a pixel; so pycolmap's cam_from_img is,
#   with the same four numbers of the lens.
# What happens: a fixed-point iteration ends after five steps, whatever is left. Within half of the image that is nothing; towards
#   the corners it converges slowly, or its last step is a large one. How far it came is not said. The same call with `criteria`
#   of 100 steps agrees with COLMAP. undistortImagePoints stops alike; undistort, for images, needs no iteration.
# Packages: opencv-python-headless 5.0.0.93 and pycolmap 4.2.1 (PyPI). Date: 2026-11-30.
# Why it matters: keypoints, markers and rays of action cameras and phones are undistorted by it before poses or depth are made
#   of them: the corners, which hold the most of a pose, pull cameras away, and it looks like a bad calibration. The undistorted
#   photograph beside them is right. Give criteria, and project back to see what is left.
# Output seen (1920 x 1080 pixels, focal length 900; along the diagonal, the part of the way to the corner and the error in pixels):
#   k1 -0.30, k2 0.10: 0.5 0.0, 0.7 0.1, 0.9 0.5, 1.0 26.8; 100 steps 1.0 0.0
#   k1 -0.35, k2 0.15: 0.5 0.1, 0.7 0.0, 0.9 13.8, 1.0 86.5; 100 steps 1.0 0.0
#   k1 -0.20, k2 0.02: 0.5 0.0, 0.7 2.9, 0.9 106.8, 1.0 10.8; 100 steps 1.0 0.0
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

WIDTH, HEIGHT, FOCAL = 1920, 1080, 900.0
centre = np.array([WIDTH / 2, HEIGHT / 2])
matrix = np.array([[FOCAL, 0, centre[0]], [0, FOCAL, centre[1]], [0, 0, 1]])
HUNDRED = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-9)
as_described = True
for lens in [(-0.3, 0.1), (-0.35, 0.15), (-0.2, 0.02)]:
    lens = np.array([*lens, 0, 0])
    camera = pycolmap.Camera(model="OPENCV", width=WIDTH, height=HEIGHT, params=[FOCAL, FOCAL, *centre, *lens])
    errors, careful = {}, {}
    for part in (0.5, 0.7, 0.9, 1.0):
        pixel = centre * (1 + part)
        ray = np.append(camera.cam_from_img(pixel[None])[0], 1)
        # COLMAP's ray is the right one: OpenCV itself projects it back to the pixel.
        projected = cv2.projectPoints(ray[None, None], np.zeros(3), np.zeros(3), matrix, lens)[0].ravel()
        if np.abs(projected - pixel).max() > 0.001:
            sys.exit(f"COLMAP's ray does not fit: {projected} for {pixel}")
        for kept, more in ((errors, {}), (careful, {"criteria": HUNDRED})):
            found = cv2.undistortPoints(pixel[None, None], matrix, lens, **more).ravel()
            kept[part] = FOCAL * np.hypot(*(found - ray[:2]))
    told = ", ".join(f"{part} {error:.1f}" for part, error in errors.items())
    print(f"k1 {lens[0]:.2f}, k2 {lens[1]:.2f}: {told}; 100 steps 1.0 {careful[1.0]:.1f}")
    as_described &= max(careful.values()) < 0.01 and errors[0.5] < 0.2 and max(errors.values()) > 20
sys.exit(not as_described)
PY

#!/usr/bin/env bash
# A level of OpenCV's pyramid lies half a pixel from that of kornia and scikit-image: each fits another camera.
#
# One would expect: pyrDown of OpenCV and of kornia, which has its name and its kernel, to show the same picture at half the
#   size, and one rule for the camera: cx / 2 where the corner of the picture is 0, as COLMAP has it.
# What happens: OpenCV keeps the centre of every second pixel, kornia and scikit-image the middle between two. Of the first the
#   camera has cx / 2 + 0.25 in COLMAP's coordinates, which is cx / 2 in OpenCV's own; of the others cx / 2, as pycolmap's
#   rescale gives and as cv2.resize with INTER_AREA. The shift is 0.5 pixels of the full picture at the first level, 1.5 at the
#   second, 3.5 at the third. pyrUp differs the same way.
# Packages: opencv-python-headless 5.0.0.93, pycolmap 4.2.1, torch 2.13.0, kornia 0.9.0 and scikit-image 0.26.0 (PyPI). Date:
#   2026-11-30.
# Why it matters: trainings from coarse to fine and metrics at several scales take such pictures. One library's photographs
#   against the other's renders have an error of several dB that no optimisation removes but by moving cameras.
# Output seen (where in the full picture, in COLMAP's coordinates, the point of the level lies that a camera with cx / 2 sees at
#   the full picture's 40; then PSNR of a level against kornia's):
#   level 1: OpenCV 39.50, kornia 40.00, scikit-image 40.00, INTER_AREA 40.00; OpenCV 36.3 dB, scikit-image 50.1 dB
#   level 2: OpenCV 38.50, kornia 40.00, scikit-image 40.00, INTER_AREA 40.00; OpenCV 28.8 dB, scikit-image 38.5 dB
#   level 3: OpenCV 36.50, kornia 40.00, scikit-image 40.00, INTER_AREA 40.00; OpenCV 27.1 dB, scikit-image 33.1 dB
#   pycolmap: cx 40 becomes 20 at half the size
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet opencv-python-headless==5.0.0.93 pycolmap==4.2.1 torch==2.13.0 kornia==0.9.0 \
  scikit-image==0.26.0 numpy scipy 2>pip.log
tools/bin/python -W ignore - <<'PY'
import sys

import cv2
import kornia
import numpy as np
import pycolmap
import torch
from scipy.ndimage import gaussian_filter
from skimage.transform import pyramid_reduce

SIZE, PLACE = 256, 40.0
SHRINK = {
    "OpenCV": cv2.pyrDown,
    "kornia": lambda picture: kornia.geometry.pyrdown(torch.from_numpy(picture)[None, None])[0, 0].numpy(),
    "scikit-image": lambda picture: pyramid_reduce(picture, 2),
    "INTER_AREA": lambda picture: cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA),
}
# The value of a pixel of the ramp is the place of its centre, with 0 at the corner of the picture.
ramp = np.tile(np.arange(SIZE, dtype=np.float32) + 0.5, (SIZE, 1))
noise = gaussian_filter(np.random.default_rng(0).normal(size=(SIZE, SIZE)), 4).astype(np.float32)
scene = (noise - noise.min()) / (noise.max() - noise.min())
ramps, scenes = dict.fromkeys(SHRINK, ramp), dict.fromkeys(SHRINK, scene)
as_described = True
for level in (1, 2, 3):
    for name, shrink in SHRINK.items():
        ramps[name], scenes[name] = shrink(ramps[name]).astype(np.float32), shrink(scenes[name]).astype(np.float32)
    width = SIZE >> level
    places = {name: np.interp(PLACE / 2**level - 0.5, np.arange(width), ramps[name][width // 2]) for name in SHRINK}
    psnr = {name: -10 * np.log10(np.mean((scenes[name] - scenes["kornia"]) ** 2)) for name in ("OpenCV", "scikit-image")}
    print(f"level {level}:", ", ".join(f"{name} {place:.2f}" for name, place in places.items()) + ";",
          ", ".join(f"{name} {value:.1f} dB" for name, value in psnr.items()))
    as_described &= abs(places.pop("OpenCV") - PLACE + (2**level - 1) / 2) < 0.02
    as_described &= np.allclose(list(places.values()), PLACE, atol=0.02) and psnr["OpenCV"] + 4 < psnr["scikit-image"]
camera = pycolmap.Camera(model="SIMPLE_PINHOLE", width=SIZE, height=SIZE, params=[100, PLACE, PLACE])
camera.rescale(0.5)
print(f"pycolmap: cx {PLACE:.0f} becomes {camera.principal_point_x:.0f} at half the size")
sys.exit(not (as_described and camera.principal_point_x == PLACE / 2))
PY

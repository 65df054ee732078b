#!/usr/bin/env bash
# image-similarity-measures scores pictures of 8 bits as if they had 12: PSNR is 24 dB too high, and SSIM close to 1.
#
# One would expect: its module evaluate, a command that reads a PNG itself, to take the range of PSNR and SSIM from the
#   picture's bits, or to ask.
# What happens: the range is 4095 for every file. The functions have an argument for it; the command, and evaluation(), which it
#   calls, cannot be told. So 20 log10(4095 / 255), 24.1 dB, are added to every PSNR. The two constants that keep SSIM from
#   dividing by 0 become 258 times as large, and outweigh the picture: another scene scores 0.89, where a copy scores 1.
# Packages: image-similarity-measures 0.3.6 and scikit-image 0.20.0 (PyPI). Date: 2026-11-30.
# Why it matters: 26 dB, a bad render, reads 50, which passes for lossless; SSIM hardly tells views apart. Tables that are made
#   by the command cannot be compared with others'. Call psnr and ssim with max_p=255.
# Output seen (PSNR and SSIM of the command, then those with the range of the picture):
#   noise of 5 %: 50.1 0.990, 26.0 0.745
#   another scene: 37.3 0.894, 13.2 0.119
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet image-similarity-measures==0.3.6 scikit-image==0.20.0 scipy 2>pip.log
tools/bin/python -W ignore - <<'PY'
import json
import subprocess
import sys

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

rng = np.random.default_rng(0)


def make_scene():
    smooth = gaussian_filter(rng.normal(size=(256, 256, 3)), (4, 4, 0))
    return np.clip(127.5 + 40 * smooth / smooth.std(), 0, 255).astype(np.uint8)


scene = make_scene()
noisy = np.clip(scene + rng.normal(size=scene.shape) * 255 * 0.05, 0, 255).astype(np.uint8)
cv2.imwrite("scene.png", scene)
as_described = True
for title, other in (("noise of 5 %", noisy), ("another scene", make_scene())):
    cv2.imwrite("other.png", other)
    command = ["tools/bin/python", "-m", "image_similarity_measures.evaluate", "--metric=psnr", "--metric=ssim"]
    told = subprocess.run([*command, "--org_img_path=scene.png", "--pred_img_path=other.png"], check=True, capture_output=True, text=True).stdout
    psnr, ssim = (json.loads(told)["metrics"][name] for name in ("psnr", "ssim"))
    right = peak_signal_noise_ratio(scene, other), structural_similarity(scene, other, channel_axis=2)
    print(f"{title}: {psnr:.1f} {ssim:.3f}, {right[0]:.1f} {right[1]:.3f}")
    as_described &= abs(psnr - right[0] - 20 * np.log10(4095 / 255)) < 0.01 and ssim > 0.85 and right[1] < 0.8
sys.exit(not as_described)
PY

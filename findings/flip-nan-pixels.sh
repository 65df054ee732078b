#!/usr/bin/env bash
# FLIP takes pixels that are not a number for black: a render that failed on black ground has no error.
#
# One would expect: a mean of NaN, as PSNR and SSIM of scikit-image give, or an error raised.
# What happens: flip-evaluator cuts colours to 0 to 1 so that NaN becomes 0. A render of NaN alone, against a scene on black of
#   which one percent is lit, has an error of 0.02; an image of infinities counts as white. The map of errors has no NaN.
# Packages: flip-evaluator 1.7 and scikit-image 0.26.0 (PyPI). Date: 2026-11-29.
# Why it matters: synthetic scenes are shown on black, and renderers make NaN of Gaussians that are degenerate. A mean over
#   views hides that some of them are lost. Check that images are finite before.
# Output seen:
#   one pixel NaN: FLIP 0.0000, PSNR nan, SSIM nan
#   all pixels NaN: FLIP 0.0215, PSNR nan, SSIM nan
#   all pixels black: FLIP 0.0215, PSNR 20.0, SSIM 0.971
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet flip-evaluator==1.7 scikit-image==0.26.0 numpy 2>pip.log
tools/bin/python -W ignore - <<'PY'
import sys

import flip_evaluator
import numpy as np
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

reference = np.zeros((100, 100, 3), np.float32)
reference[45:55, 45:55] = 1
one = reference.copy()
one[0, 0] = np.nan
cases = {"one pixel NaN": one, "all pixels NaN": np.full_like(reference, np.nan), "all pixels black": np.zeros_like(reference)}
found = {}
for title, image in cases.items():
    flip = flip_evaluator.evaluate(reference, image, "LDR")[1]
    psnr = peak_signal_noise_ratio(reference, image, data_range=1)
    ssim = structural_similarity(reference, image, data_range=1, channel_axis=2)
    print(f"{title}: FLIP {flip:.4f}, PSNR {psnr:.1f}, SSIM {ssim:.3f}")
    found[title] = flip, psnr
finite = np.isfinite([flip for flip, _ in found.values()]).all()
same = found["all pixels NaN"][0] == found["all pixels black"][0]
sys.exit(not (finite and same and np.isnan(found["all pixels NaN"][1])))
PY

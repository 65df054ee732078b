#!/usr/bin/env bash
# torchmetrics' PSNR over views is that of their pooled error, far below the mean of their PSNRs; its SSIM is the mean.
#
# One would expect: update() for each view and compute() at the end to give the mean over views, as it does for SSIM, and as the
#   argument reduction="elementwise_mean" and papers on Gaussians have it.
# What happens: squared errors of all views are summed before the logarithm, so the worst view counts most. Views of 46, 26 and
#   12 dB have 16.7 dB together, 11.4 dB below their mean. With dim=(1, 2, 3), by which the logarithm is taken for each
#   image, it is the mean; without dim, reduction does nothing.
# Packages: torchmetrics 1.9.0 and torch 2.13.0 (PyPI). Date: 2026-11-29.
# Why it matters: trainers of Gaussians evaluate with these classes. Tables compare such figures to 0.1 dB: one made by compute()
#   and one made by a loop over views differ by more than methods do. Say which it is, and give dim.
# Output seen:
#   PSNR of the views 46.1 26.3 12.1, mean 28.1, compute() 16.7, with dim 28.1
#   SSIM of the views 1.00 0.99 0.68, mean 0.89, compute() 0.89
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet torchmetrics==1.9.0 torch==2.13.0 numpy 2>pip.log
tools/bin/python -W ignore - <<'PY'
import sys

import torch
from torchmetrics.image import PeakSignalNoiseRatio, StructuralSimilarityIndexMeasure

torch.manual_seed(0)
reference = torch.rand(1, 3, 64, 64)
views = [(reference + noise * torch.randn_like(reference)).clamp(0, 1) for noise in (0.005, 0.05, 0.3)]


def measure(make):
    alone = [float(make()(view, reference)) for view in views]
    metric = make()
    for view in views:
        metric.update(view, reference)
    return alone, sum(alone) / len(alone), float(metric.compute())


psnrs, mean, pooled = measure(lambda: PeakSignalNoiseRatio(data_range=1.0))
by_image = measure(lambda: PeakSignalNoiseRatio(data_range=1.0, dim=(1, 2, 3)))[2]
ssims, mean_ssim, ssim = measure(lambda: StructuralSimilarityIndexMeasure(data_range=1.0))
print("PSNR of the views", *(f"{value:.1f}" for value in psnrs), end="")
print(f", mean {mean:.1f}, compute() {pooled:.1f}, with dim {by_image:.1f}")
print("SSIM of the views", *(f"{value:.2f}" for value in ssims), end="")
print(f", mean {mean_ssim:.2f}, compute() {ssim:.2f}")
sys.exit(not (mean - pooled > 10 and abs(by_image - mean) < 0.01 and abs(ssim - mean_ssim) < 0.001))
PY

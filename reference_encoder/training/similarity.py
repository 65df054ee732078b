"""L1 and SSIM of a picture against a photo, with the gradient written out (Wang et al. 2004; paper §3.5).

SSIM with a Gaussian window of 11 pixels, sigma 1.5, zeros beyond the edges, a map a channel. On processors the loops
are C (similarity.c), a fifth of the time of torch's; elsewhere the same in torch. Photos are (H, W, 3) uint8, and
nothing is kept of them.
"""

from __future__ import annotations

import ctypes
from functools import cache, partial
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from reference_encoder.training.fixed_order import mean
from reference_encoder.training.raster.compiled import on_threads
from scarfmt.render.native.binding import load


class Similarity(ctypes.Structure):
    """The arguments of a call of similarity.c; `Similarity` there describes each."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("picture", "photo", "window")),
        *((name, ctypes.c_void_p) for name in ("by_mean", "by_square", "by_product", "gradient", "sums", "scratch")),
        ("height", ctypes.c_int64),
        ("width", ctypes.c_int64),
        ("share", ctypes.c_float),
        ("c1", ctypes.c_float),
        ("c2", ctypes.c_float),
    )


@cache
def _library() -> ctypes.CDLL:
    library = load()
    library.scar_similarity.restype = None
    library.scar_similarity.argtypes = [ctypes.POINTER(Similarity), *[ctypes.c_int64] * 4]
    return library


_RADIUS, _SIGMA = 5, 1.5
_REACH, _MAPS = 3 * _RADIUS, 5
_C1, _C2 = 0.01**2, 0.03**2
SSIM_SHARE = 0.2
"""Share of 1 - SSIM in the loss of a picture, as in 3DGS and Scaffold-GS; the rest is L1 (paper §3.5)."""


def _window() -> list[float]:
    weights = torch.exp(-(torch.arange(_RADIUS + 1, dtype=torch.float64) ** 2) / (2 * _SIGMA**2))
    return [float(weight) for weight in weights / (2 * weights.sum() - weights[0])]


_WINDOW = _window()


def blur(maps: Tensor) -> Tensor:
    """(H, W, c) maps under the window, zeros beyond the edges: its own adjoint.

    Shifted sums: a convolution of one channel takes ten times as long on processors.
    """
    for axis in (0, 1):
        size = maps.shape[axis]
        edges = (0, 0, 0, 0, _RADIUS, _RADIUS) if axis == 0 else (0, 0, _RADIUS, _RADIUS)
        wide = functional.pad(maps, edges)
        maps = wide.narrow(axis, _RADIUS, size) * _WINDOW[0]
        for reach in range(1, _RADIUS + 1):
            maps = maps + _WINDOW[reach] * wide.narrow(axis, _RADIUS - reach, size)
            maps = maps + _WINDOW[reach] * wide.narrow(axis, _RADIUS + reach, size)
    return maps


def intensities(photo: Tensor) -> Tensor:
    """(H, W, 3) float32, 0..1."""
    return photo.contiguous().float() / 255


def _compiled(picture: Tensor, photo: Tensor, share: float) -> tuple[Tensor, Tensor]:
    """Value and gradient by similarity.c."""
    height, width, _ = picture.shape
    threads = torch.get_num_threads()
    slopes = torch.empty(4, height, width, 3)
    sums = torch.empty(height, 2, dtype=torch.float64)
    scratch = torch.empty(threads, 2 * _MAPS * (3 * width + 2 * _REACH))
    window = torch.tensor(_WINDOW)
    tensors = (picture, intensities(photo), window, *slopes, sums, scratch)
    job = Similarity(*(tensor.data_ptr() for tensor in tensors), height, width, share, _C1, _C2)
    for phase in (1, 2):
        on_threads(partial(_library().scar_similarity, ctypes.byref(job), phase), height)
    l1, similar = (sums.sum(dim=0) / picture.numel()).float()
    return (1 - share) * l1 + share * (1 - similar), slopes[3]


def _by_torch(x: Tensor, photo: Tensor, share: float) -> tuple[Tensor, Tensor]:
    """Value and gradient, formula by formula as in similarity.c."""
    y = intensities(photo)
    mean, square, product, my, sy = blur(torch.cat([x, x * x, x * y, y, y * y], dim=2)).chunk(_MAPS, dim=2)
    a1, b1 = 2 * mean * my + _C1, mean**2 + my**2 + _C1
    a2 = 2 * (product - mean * my) + _C2
    b2 = (square - mean**2) + (sy - my**2) + _C2
    scale = 1 / (b1 * b2)
    ssim = a1 * a2 * scale
    by_product, by_square = 2 * a1 * scale, -ssim / b2
    by_mean = 2 * (my * a2 * scale - mean * ssim / b1 - mean * by_square) - my * by_product
    through = blur(torch.cat([by_mean, by_square, by_product], dim=2)).chunk(3, dim=2)
    gradient = through[0] + 2 * x * through[1] + y * through[2]
    gradient = ((1 - share) * torch.sign(x - y) - share * gradient) / x.numel()
    return (1 - share) * (x - y).abs().mean() + share * (1 - ssim.mean()), gradient


class _Dissimilarity(torch.autograd.Function):
    """The gradient is found on the way forward."""

    @staticmethod
    def forward(ctx: Any, picture: Tensor, photo: Tensor, share: float) -> Tensor:
        compute = _compiled if picture.device.type == "cpu" else _by_torch
        value, gradient = compute(picture.contiguous(), photo, share)
        ctx.save_for_backward(gradient)
        return value

    @staticmethod
    def backward(ctx: Any, *outputs: Any) -> tuple[Tensor, None, None]:
        (gradient,) = ctx.saved_tensors
        return outputs[0] * gradient, None, None


def dissimilarity(picture: Tensor, photo: Tensor, share: float = SSIM_SHARE) -> Tensor:
    """(1 - share) L1 + share (1 - SSIM) of an (H, W, 3) picture, a scalar that is differentiable once."""
    return _Dissimilarity.apply(picture, photo, share)  # type: ignore[no-any-return,no-untyped-call]


@torch.no_grad()
def ssim(picture: Tensor, photo: Tensor) -> float:
    """Mean SSIM of an (H, W, 3) picture."""
    return 1 - float(dissimilarity(picture, photo, 1.0))


@torch.no_grad()
def psnr(picture: Tensor, photo: Tensor) -> float:
    """PSNR in dB of an (H, W, 3) picture rounded to 8 bits."""
    shown = torch.round(picture.clamp(0, 1) * 255) / 255
    error = mean(((shown - intensities(photo)) ** 2).double())
    return float(-10 * torch.log10(error))

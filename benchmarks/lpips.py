"""LPIPS (Zhang et al. 2018) on plain torch, with weights from files of the user's: nothing is fetched.

The files are state dicts, one or more: the convolutions of AlexNet or VGG16, trained on ImageNet, and the five heads of
LPIPS 0.1. Names are those of torchvision (``features.0.weight``) or of the package lpips (``net.slice1.0.weight``,
``lin0.model.1.weight``), so a state dict of its whole model will do.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor
from torch.nn.functional import conv2d, max_pool2d, relu

from scarfmt.arrays import F32

_SHIFT, _SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)
"""Mean and deviation of ImageNet's photos, in -1..1."""
_CONVOLUTION = re.compile(r"(?:features|net\.slice\d)\.(\d+)\.(weight|bias)")
_HEAD = re.compile(r"lin(\d)\.model\.1\.weight")
_LEAST_LENGTH = 1e-10


@dataclass(frozen=True)
class Backbone:
    """A network without its classifier.

    Attributes:
        groups: numbers of convolutions; what is compared is the last of each group, after its ReLU.
        pools: width of the pooling by steps of 2 before each group, 0 for none.
        forms: stride and padding of convolutions by number; others have 1 and 1.
    """

    groups: tuple[tuple[int, ...], ...]
    pools: tuple[int, ...]
    forms: Mapping[int, tuple[int, int]]


ALEXNET = Backbone(((0,), (3,), (6,), (8,), (10,)), (0, 3, 3, 0, 0), {0: (4, 2), 3: (1, 2)})
VGG16 = Backbone(((0, 2), (5, 7), (10, 12, 14), (17, 19, 21), (24, 26, 28)), (0, 2, 2, 2, 2), {})
_WIDTH_OF_FIRST = {11: ALEXNET, 3: VGG16}


class Lpips:
    """The metric.

    Args:
        weights: tensors by name, see above; others are left alone.

    Raises:
        ValueError: some are missing, or of no network that is known.
    """

    def __init__(self, weights: Mapping[str, Tensor]) -> None:
        self._layers: dict[tuple[int, str], Tensor] = {}
        self._heads: dict[int, Tensor] = {}
        for name, value in weights.items():
            if found := _CONVOLUTION.fullmatch(name):
                self._layers[int(found[1]), found[2]] = value.float()
            elif found := _HEAD.fullmatch(name):
                self._heads[int(found[1])] = value.float()
        first = self._layers.get((0, "weight"))
        if first is None or first.shape[-1] not in _WIDTH_OF_FIRST:
            raise ValueError("LPIPS: no convolutions of AlexNet or VGG16 (features.0.weight) are in the files")
        self.backbone = _WIDTH_OF_FIRST[first.shape[-1]]
        wanted = {(number, part) for group in self.backbone.groups for number in group for part in ("weight", "bias")}
        missing = [f"features.{number}.{part}" for number, part in sorted(wanted - set(self._layers))]
        missing += [f"lin{k}.model.1.weight" for k in range(len(self.backbone.groups)) if k not in self._heads]
        if missing:
            raise ValueError(f"LPIPS: the files lack {', '.join(missing)}")

    @torch.no_grad()
    def distance(self, a: F32, b: F32, mapped: bool = True) -> float:
        """LPIPS of two (height, width, 3) pictures, 0..1.

        Args:
            a, b: the pictures.
            mapped: to -1..1 first, as the metric is defined. The tables of 3DGS and its kin are of pictures left in
                0..1.
        """
        total = 0.0
        for head, (x, y) in enumerate(zip(self._features(a, mapped), self._features(b, mapped), strict=True)):
            error = (_directions(x) - _directions(y)) ** 2
            total += float(conv2d(error, self._heads[head]).mean())
        return total

    def _features(self, picture: F32, mapped: bool) -> list[Tensor]:
        """The features that are compared, each (1, channels, h, w)."""
        shift, scale = (torch.tensor(values)[:, None, None] for values in (_SHIFT, _SCALE))
        x = torch.from_numpy(picture).permute(2, 0, 1).contiguous()
        x = (((2 * x - 1 if mapped else x) - shift) / scale)[None]
        found = []
        for group, pool in zip(self.backbone.groups, self.backbone.pools, strict=True):
            x = max_pool2d(x, pool, 2) if pool else x
            for number in group:
                stride, padding = self.backbone.forms.get(number, (1, 1))
                x = relu(conv2d(x, self._layers[number, "weight"], self._layers[number, "bias"], stride, padding))
            found.append(x)
        return found


def _directions(features: Tensor) -> Tensor:
    return features / (torch.sqrt((features**2).sum(dim=1, keepdim=True)) + _LEAST_LENGTH)


def load_lpips(paths: Sequence[Path]) -> Lpips:
    """The metric of weights in files that `torch.save` wrote.

    Raises:
        ValueError: see `Lpips`.
        OSError, pickle.UnpicklingError: a file cannot be read, or holds more than tensors.
    """
    weights: dict[str, Tensor] = {}
    for path in paths:
        weights |= torch.load(path, map_location="cpu", weights_only=True)
    return Lpips(weights)

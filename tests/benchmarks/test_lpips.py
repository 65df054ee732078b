"""LPIPS: the network of its definition, whatever its weights are called; missing weights are reported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from benchmarks.lpips import ALEXNET, VGG16, Backbone, Lpips, load_lpips
from scarfmt.arrays import F32

CHANNELS = {
    "alexnet": (ALEXNET, {0: (3, 64, 11), 3: (64, 192, 5), 6: (192, 384, 3), 8: (384, 256, 3), 10: (256, 256, 3)}),
    "vgg16": (
        VGG16,
        {
            0: (3, 64, 3), 2: (64, 64, 3), 5: (64, 128, 3), 7: (128, 128, 3), 10: (128, 256, 3),
            12: (256, 256, 3), 14: (256, 256, 3), 17: (256, 512, 3),
            **dict.fromkeys((19, 21, 24, 26, 28), (512, 512, 3)),
        },
    ),
}


def weights(name: str) -> dict[str, Tensor]:
    """Drawn at random, by the names of torchvision, and heads."""
    backbone, channels = CHANNELS[name]
    generator = torch.Generator().manual_seed(1)
    found = {}
    for number, (inputs, outputs, width) in channels.items():
        scale = (2 / (inputs * width**2)) ** 0.5
        found[f"features.{number}.weight"] = scale * torch.randn(outputs, inputs, width, width, generator=generator)
        found[f"features.{number}.bias"] = 0.1 * torch.randn(outputs, generator=generator)
    for head, group in enumerate(backbone.groups):
        count = channels[group[-1]][1]
        found[f"lin{head}.model.1.weight"] = torch.rand(1, count, 1, 1, generator=generator)
    return found


def pictures() -> tuple[F32, F32]:
    random = np.random.default_rng(2)
    first = random.random((48, 64, 3)).astype(np.float32)
    return first, np.clip(first + 0.2 * random.normal(size=first.shape), 0, 1).astype(np.float32)


def modules(backbone: Backbone, given: dict[str, Tensor]) -> nn.Sequential:
    """The network as torchvision lays it out, module by module."""
    found: list[nn.Module] = []
    for group, pool in zip(backbone.groups, backbone.pools, strict=True):
        found += [nn.MaxPool2d(pool, 2)] if pool else []
        for number in group:
            weight = given[f"features.{number}.weight"]
            stride, padding = backbone.forms.get(number, (1, 1))
            layer = nn.Conv2d(weight.shape[1], weight.shape[0], weight.shape[2], stride, padding)
            layer.weight.data, layer.bias.data = weight, given[f"features.{number}.bias"]  # type: ignore[union-attr]
            assert len(found) == number
            found += [layer, nn.ReLU()]
    return nn.Sequential(*found)


@pytest.mark.parametrize("name", CHANNELS)
@pytest.mark.parametrize("mapped", [True, False])
def test_it_is_the_weighted_distance_of_directions_of_features(name: str, mapped: bool) -> None:
    """Computed here in another way: by modules whose numbers are those of the weights, a pixel's vectors by einsum."""
    given, (a, b) = weights(name), pictures()
    backbone = CHANNELS[name][0]
    both = torch.from_numpy(np.stack([a, b])).permute(0, 3, 1, 2)
    both = both * 2 - 1 if mapped else both
    shift, scale = torch.tensor([-0.030, -0.088, -0.188]), torch.tensor([0.458, 0.448, 0.450])
    x, total, ends = (both - shift.view(1, 3, 1, 1)) / scale.view(1, 3, 1, 1), 0.0, [g[-1] + 1 for g in backbone.groups]
    with torch.no_grad():
        for number, module in enumerate(modules(backbone, given)):
            x = module(x)
            if number in ends:
                unit = nn.functional.normalize(x, dim=1)
                head = given[f"lin{ends.index(number)}.model.1.weight"].flatten()
                total += float(torch.einsum("chw,c->hw", (unit[0] - unit[1]) ** 2, head).mean())
    assert Lpips(given).distance(a, b, mapped) == pytest.approx(total, rel=1e-3)
    assert Lpips(given).distance(a, a, mapped) == 0


def test_weights_by_either_name_in_one_file_or_two(tmp_path: Path) -> None:
    """The package's whole model, or torchvision's network and the package's heads; other tensors do no harm."""
    given, (a, b) = weights("alexnet"), pictures()
    slices = {0: 1, 3: 2, 6: 3, 8: 4, 10: 5}
    whole = {"scaling_layer.shift": torch.zeros(1, 3, 1, 1), "lins.0.model.1.weight": torch.zeros(1)}
    for name, value in given.items():
        part = name.split(".")
        whole[f"net.slice{slices[int(part[1])]}.{part[1]}.{part[2]}" if part[0] == "features" else name] = value
    network = {name: value for name, value in given.items() if name.startswith("features")}
    heads = {name: value for name, value in given.items() if name.startswith("lin")}
    paths = [tmp_path / name for name in ("whole.pt", "network.pt", "heads.pt")]
    for path, content in zip(paths, (whole, network, heads), strict=True):
        torch.save(content, path)
    assert load_lpips(paths[:1]).distance(a, b) == load_lpips(paths[1:]).distance(a, b)
    with pytest.raises(ValueError, match=r"lack lin0\.model\.1\.weight"):
        load_lpips(paths[1:2])
    with pytest.raises(ValueError, match="no convolutions"):
        load_lpips(paths[2:])

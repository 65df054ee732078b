"""The loss: the same from C, torch and plain autograd in binary64; the same for any number of threads."""

from collections.abc import Iterator

import pytest
import torch
from torch import Tensor

from reference_encoder.training import similarity
from reference_encoder.training.similarity import dissimilarity, intensities, psnr, ssim


@pytest.fixture(params=[1, 2, 3])
def threads(request: pytest.FixtureRequest) -> Iterator[int]:
    """Some number of threads, and afterwards the one before."""
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield request.param
    torch.set_num_threads(before)


def _pair(height: int, width: int, least: float = 0.0) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(height * width)
    photo = torch.randint(int(255 * least), 256, (height, width, 3), generator=generator, dtype=torch.uint8)
    return least + (1 - least) * torch.rand(height, width, 3, generator=generator), photo


def _dense(x: Tensor, y: Tensor, share: float) -> Tensor:
    """The definition, with a convolution and binary64."""
    reach = torch.arange(-5, 6, dtype=torch.float64)
    line = torch.exp(-(reach**2) / (2 * 1.5**2))
    window = torch.outer(line, line)[None, None] / line.sum() ** 2

    def mean(maps: Tensor) -> Tensor:
        return torch.nn.functional.conv2d(maps.permute(2, 0, 1)[:, None], window, padding=5)[:, 0].permute(1, 2, 0)

    mx, my = mean(x), mean(y)
    above = (2 * mx * my + 0.01**2) * (2 * (mean(x * y) - mx * my) + 0.03**2)
    below = (mx**2 + my**2 + 0.01**2) * (mean(x * x) - mx**2 + mean(y * y) - my**2 + 0.03**2)
    return (1 - share) * (x - y).abs().mean() + share * (1 - (above / below).mean())


@pytest.mark.parametrize(("height", "width", "least"), [(41, 53, 0.0), (16, 16, 0.0), (5, 70, 0.0), (30, 30, 0.9)])
@pytest.mark.parametrize("share", [0.0, 0.2, 1.0])
def test_value_and_gradient_are_those_of_the_definition(
    height: int, width: int, least: float, share: float, threads: int
) -> None:
    """Gradients written out agree with autograd, also beside the edges and where a picture hardly varies."""
    x, photo = _pair(height, width, least)
    exact = x.double().requires_grad_()
    _dense(exact, intensities(photo).double(), share).backward()
    given = x.clone().requires_grad_()
    loss = dissimilarity(given, photo, share)
    loss.backward()
    assert float(loss) == pytest.approx(float(_dense(x.double(), intensities(photo).double(), share)), abs=1e-5)
    assert (given.grad - exact.grad).abs().max() <= 1e-4 * exact.grad.abs().max()


def test_torch_gives_what_c_gives() -> None:
    """Elsewhere than on processors the same formulas run in torch."""
    x, photo = _pair(33, 47)
    value, gradient = similarity._by_torch(x, photo, 0.2)
    mine = x.clone().requires_grad_()
    loss = dissimilarity(mine, photo, 0.2)
    loss.backward()
    assert float(loss) == pytest.approx(float(value), abs=1e-6)
    assert torch.allclose(mine.grad, gradient, rtol=0, atol=1e-6 * float(gradient.abs().max()))


def test_threads_change_nothing(threads: int) -> None:
    """Sums are a row's own, and rows are added in order."""
    x, photo = _pair(64, 40)
    found = similarity._compiled(x, photo, 0.2)
    torch.set_num_threads(1)
    alone = similarity._compiled(x, photo, 0.2)
    assert torch.equal(found[0], alone[0])
    assert torch.equal(found[1], alone[1])


def test_a_photo_whose_rows_are_not_side_by_side_is_read_right() -> None:
    """A transposed view of pixels is a photo like any other."""
    x, photo = _pair(20, 30)
    turned = photo.permute(1, 0, 2).contiguous().permute(1, 0, 2)
    assert torch.equal(dissimilarity(x, turned, 0.2), dissimilarity(x, photo, 0.2))


def test_measures_of_the_photo_itself() -> None:
    """A picture that is the photo has SSIM 1 and no error; PSNR is of values rounded to 8 bits."""
    _, photo = _pair(20, 30)
    assert ssim(intensities(photo), photo) == pytest.approx(1.0, abs=1e-6)
    assert psnr(intensities(photo) + 0.4 / 255, photo) == float("inf")
    assert psnr((intensities(photo) - 10 / 255).clamp(0, 1), photo) == pytest.approx(28.3, abs=0.3)

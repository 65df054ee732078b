"""The Triton kernels draw what C draws, and their gradients are those of dense float64 autograd.

Run on a GPU where there is one, `python -m pytest -m triton`, or on the CPU by Triton's interpreter:
`TRITON_INTERPRET=1 python -m pytest -m triton`.
"""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
import torch
from torch import Tensor

from reference_encoder.training.raster import rasterise
from reference_encoder.training.raster.compiled import Gaussians

from .dense import render_dense
from .scenes import SCENES, leaves, turned_camera
from .test_picture import BACKGROUND, TOLERANCE, error, towards

INTERPRETED = os.environ.get("TRITON_INTERPRET") == "1"
WHERE = torch.device("cpu" if INTERPRETED else "cuda")
pytestmark = [
    pytest.mark.triton,
    pytest.mark.skipif(not (INTERPRETED or torch.cuda.is_available()), reason="needs a GPU or TRITON_INTERPRET=1"),
]


def placed(scene: Gaussians) -> Gaussians:
    """Leaves of the scene in float32 where the kernels run, with gradients."""
    return Gaussians(*(one.detach().float().to(WHERE).requires_grad_() for one in scene.tensors()))


def apart(found: Tensor | None, expected: Tensor | None) -> float:
    """The error of a gradient from where the kernels run."""
    assert found is not None
    return error(found.cpu(), expected)


@pytest.mark.parametrize("name", SCENES)
def test_gradients_of_every_input_are_those_of_dense_autograd(name: str) -> None:
    pytest.importorskip("triton", reason="Triton is not installed")
    from reference_encoder.training.raster.cuda import draw

    scene, camera = SCENES[name](0), turned_camera()
    here, there = placed(scene), leaves(scene, torch.float64)
    background = BACKGROUND.to(WHERE, copy=True).requires_grad_()
    background64 = BACKGROUND.double().requires_grad_()
    image, means, which, weights = draw(here, camera, background)
    means.retain_grad()
    dense = render_dense(there, camera, background64)
    (image * towards(camera).to(WHERE)).sum().backward()
    (dense.image * towards(camera).double()).sum().backward()
    assert float((image.cpu() - dense.image).detach().abs().max()) < TOLERANCE
    for one, two in zip(here.tensors(), there.tensors(), strict=True):
        assert apart(one.grad, two.grad) < TOLERANCE
    assert apart(means.grad, dense.means.grad) < TOLERANCE
    assert apart(background.grad, background64.grad) < TOLERANCE
    expected = dense.weights[which.cpu()].double()
    torch.testing.assert_close(weights.cpu().double(), expected, rtol=1e-4, atol=1e-4)


def test_a_picture_that_is_no_whole_number_of_tiles_is_that_of_c() -> None:
    pytest.importorskip("triton", reason="Triton is not installed")
    from reference_encoder.training.raster.cuda import draw

    scene, camera = SCENES["mixed"](2), turned_camera(45, 35)
    with torch.no_grad():
        image, _, which, weights = (one.cpu() for one in draw(placed(scene), camera, BACKGROUND.to(WHERE)))
    picture = rasterise(scene, camera, BACKGROUND)
    torch.testing.assert_close(image, picture.image, rtol=0, atol=1e-5)
    torch.testing.assert_close(weights, picture.weights[which], rtol=1e-4, atol=1e-4)
    assert torch.equal(picture.shown.nonzero()[:, 0], which.sort().values)


def test_nothing_to_draw() -> None:
    pytest.importorskip("triton", reason="Triton is not installed")
    from reference_encoder.training.raster.cuda import draw

    none = Gaussians(torch.empty(0, 3), torch.empty(0, 3), torch.empty(0, 4), torch.empty(0), torch.empty(0, 3))
    image, _, which, _ = draw(placed(none), turned_camera(), BACKGROUND.to(WHERE))
    assert torch.equal(image.detach().cpu(), BACKGROUND.expand(32, 32, 3))
    assert len(which) == 0


COMPILE = """
from triton import compile
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource
from reference_encoder.training.raster.triton_kernels import blend, unblend

LISTS, SIZES, RULES = ["*fp32", "*i64", "*i32", "*i32"], ["i32"] * 3, ["fp32"] * 3
for kernel, own in ((blend, ["*fp32"] * 4 + ["*i32"]), (unblend, ["*fp32", "*fp32", "*i32", "*fp32"])):
    signature = dict(zip(kernel.arg_names, [*LISTS, *own, *SIZES, *RULES, "constexpr"], strict=True))
    source = ASTSource(fn=kernel, signature=signature, constexprs={"TILE": 16})
    made = compile(source, target=GPUTarget("cuda", 90, 32))
    assert "atom" not in made.asm["ptx"] and "red.global" not in made.asm["ptx"]
"""


def test_kernels_compile_for_cuda_without_atomics() -> None:
    """The interpreter takes programs that the compiler does not; sums by atomics would differ from run to run."""
    pytest.importorskip("triton", reason="Triton is not installed")
    environment = {name: value for name, value in os.environ.items() if name != "TRITON_INTERPRET"}
    run = subprocess.run([sys.executable, "-c", COMPILE], env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr

"""The Triton kernels draw what C draws, and their gradients are those of dense float64 autograd.

Run on the CPU by Triton's interpreter: `TRITON_INTERPRET=1 python -m pytest -m triton`.
"""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
import torch

from reference_encoder.training.raster import rasterise
from reference_encoder.training.raster.gaussians import Gaussians

from .dense import render_dense
from .scenes import SCENES, leaves, turned_camera
from .test_picture import BACKGROUND, TOLERANCE, error, towards

pytestmark = [
    pytest.mark.triton,
    pytest.mark.skipif(os.environ.get("TRITON_INTERPRET") != "1", reason="needs TRITON_INTERPRET=1"),
]


@pytest.mark.parametrize("name", SCENES)
def test_gradients_of_every_input_are_those_of_dense_autograd(name: str) -> None:
    pytest.importorskip("triton", reason="Triton is not installed")
    from reference_encoder.training.raster.cuda import draw

    scene, camera = SCENES[name](0), turned_camera()
    here, there = leaves(scene, torch.float32), leaves(scene, torch.float64)
    background, background64 = BACKGROUND.clone().requires_grad_(), BACKGROUND.double().requires_grad_()
    image, means, which, weights = draw(here, camera, background)
    means.retain_grad()
    dense = render_dense(there, camera, background64)
    (image * towards(camera)).sum().backward()
    (dense.image * towards(camera).double()).sum().backward()
    assert float((image - dense.image).detach().abs().max()) < TOLERANCE
    for one, two in zip(here.tensors(), there.tensors(), strict=True):
        assert error(one.grad, two.grad) < TOLERANCE
    assert error(means.grad, dense.means.grad) < TOLERANCE
    assert error(background.grad, background64.grad) < TOLERANCE
    torch.testing.assert_close(weights.double(), dense.weights[which].double(), rtol=1e-4, atol=1e-4)


def test_a_picture_that_is_no_whole_number_of_tiles_is_that_of_c() -> None:
    pytest.importorskip("triton", reason="Triton is not installed")
    from reference_encoder.training.raster.cuda import draw

    scene, camera = SCENES["mixed"](2), turned_camera(45, 35)
    image, _, which, weights = draw(scene, camera, BACKGROUND)
    picture = rasterise(scene, camera, BACKGROUND)
    torch.testing.assert_close(image, picture.image, rtol=0, atol=1e-5)
    torch.testing.assert_close(weights, picture.weights[which], rtol=1e-4, atol=1e-4)
    assert torch.equal(picture.shown.nonzero()[:, 0], which.sort().values)


def test_nothing_to_draw() -> None:
    pytest.importorskip("triton", reason="Triton is not installed")
    from reference_encoder.training.raster.cuda import draw

    none = Gaussians(torch.empty(0, 3), torch.empty(0, 3), torch.empty(0, 4), torch.empty(0), torch.empty(0, 3))
    image, _, which, _ = draw(none, turned_camera(), BACKGROUND)
    assert torch.equal(image, BACKGROUND.expand(32, 32, 3))
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

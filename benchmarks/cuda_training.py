"""Whether an NVIDIA GPU trains what the processor trains, and how fast.

    python -m benchmarks.cuda_training CAPTURE                        photos of 640 pixels, 300 iterations
    python -m benchmarks.cuda_training CAPTURE --resolution 1600 --iterations 3000

Both draw 100,000 Gaussians and differentiate the picture. The processor trains a scene a little. From its checkpoint
both take the same iteration: picture, loss, bits and gradients are compared. Then both train whole files: the GPU's
twice, which must be the same bytes and decode.

Exits with 1 if anything is off by more than the tolerances below, with 77 if there is no such GPU or no Triton:
nothing was compared then.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import torch

from benchmarks.report import SKIPPED, table
from benchmarks.training_step import CAMERA, made_up
from reference_encoder.training.capture import Capture, load_capture
from reference_encoder.training.curriculum import moment
from reference_encoder.training.device import reproducible, run_device
from reference_encoder.training.evaluate import drawn
from reference_encoder.training.iterate import Mode, iterate, priced
from reference_encoder.training.options import PRESETS, TrainOptions
from reference_encoder.training.raster import Gaussians, rasterise
from reference_encoder.training.run import begun, train
from reference_encoder.training.trainer import Trainer
from scarfmt.api import decode_scene
from scarfmt.errors import InvalidInput

WARM_ITERATIONS, ITERATIONS, RESOLUTION = 60, 300, 640
GAUSSIANS, ROUNDS = 100_000, 30
EXACT, ROUNDED = "values as they are", "values of the file"
_DONE = {EXACT: 0.0, ROUNDED: 0.9}
"""Parts of the run whose iterations are compared: neither has noise, whose numbers are each device's own."""


@dataclass(frozen=True)
class Errors:
    """How far two iterations are apart.

    Attributes:
        picture: mean absolute difference, 1 is white.
        jumps: share of its numbers that differ by more than 1e-3.
        loss, bits: relative.
        gradient: norm of the difference by the norm, the largest of all parameters.
        parameter: whose that is.
    """

    picture: float
    jumps: float
    loss: float
    bits: float
    gradient: float
    parameter: str = ""

    def within(self, most: Errors) -> bool:
        """Whether none is above that of `most`, or not a number."""
        names = ("picture", "jumps", "loss", "bits", "gradient")
        return all(getattr(self, name) <= getattr(most, name) for name in names)


MOST = {
    # Whether an alpha of 1/255 shows is decided in binary32, so some pixels jump (docs/training.md).
    EXACT: Errors(1e-5, 1e-4, 1e-5, 1e-4, 1e-3),
    # A value on the edge of a cell may be rounded either way, which moves its Gaussians by a cell.
    ROUNDED: Errors(1e-4, 1e-2, 1e-3, 1e-3, 5e-2),
}
"""Tolerances by what is compared."""


@dataclass(frozen=True)
class Iteration:
    """The result of one iteration on the processor.

    Attributes:
        picture: (H, W, 3).
        loss, bits: of the picture; of all anchors in the last layer.
        gradients: of loss and rate, by parameter.
    """

    picture: torch.Tensor
    loss: float
    bits: float
    gradients: dict[str, torch.Tensor]


def iteration(trainer: Trainer, what: str) -> Iteration:
    """The iteration of a trainer's first photo, without the step."""
    state, (camera, target) = trainer.state, trainer.views[0]
    now, last = replace(moment(trainer.curriculum, _DONE[what]), noisy=False), state.plan.count - 1
    picture = drawn(state, camera, None if what == EXACT else last, trainer.background)
    mode = Mode(last, now, True, 0.0, trainer.ssim_share)
    loss = iterate(state, camera, target, mode, trainer.background).loss
    everyone = torch.arange(len(state.anchors), device=state.device)
    bits = priced(state, everyone, replace(mode, now=moment(trainer.curriculum, _DONE[ROUNDED]))).total
    (trainer.prices.a_bit(last) * bits).backward()  # type: ignore[no-untyped-call]
    gradients = {
        name: values.grad.cpu() for name, values in state.descent.parameters.items() if values.grad is not None
    }
    for values in state.descent.parameters.values():
        values.grad = None
    return Iteration(picture.cpu(), loss, float(bits.detach()), gradients)


def apart(one: Iteration, other: Iteration) -> Errors:
    """How far another iteration is from one."""
    off = (one.picture - other.picture).abs()
    if one.gradients.keys() != other.gradients.keys():
        return Errors(float(off.mean()), 0.0, 0.0, 0.0, float("inf"), "some have none")
    norms = {name: float(values.double().norm()) for name, values in one.gradients.items()}
    by_name = {
        name: float((values.double() - other.gradients[name].double()).norm()) / max(norms[name], 1e-30)
        for name, values in one.gradients.items()
        if norms[name] > 0 or float(other.gradients[name].abs().max()) > 0
    }
    worst = max(by_name, key=lambda name: by_name[name])
    loss, bits = abs(other.loss / one.loss - 1), abs(other.bits / one.bits - 1)
    return Errors(float(off.mean()), float((off > 1e-3).double().mean()), loss, bits, by_name[worst], worst)


def compared(capture: Capture, options: TrainOptions, iterations: int = WARM_ITERATIONS) -> dict[str, Errors]:
    """How far one iteration on CUDA is from the processor's, after so many of the processor."""
    here = begun(capture, replace(options, device="cpu"))
    for number in range(iterations):
        here.step(0.5 * number / iterations)
    here.settle()
    there = begun(capture, replace(options, device="cuda"))
    there.resume(here.checkpoint())
    return {what: apart(iteration(here, what), iteration(there, what)) for what in _DONE}


@dataclass(frozen=True)
class Drawing:
    """A picture of many Gaussians and its gradient on one device.

    Attributes:
        picture: (H, W, 3), and `gradients` of its sum weighted by chance, one a parameter; on the processor.
        forward, backward: milliseconds, medians of the rounds after the first.
    """

    picture: torch.Tensor
    gradients: list[torch.Tensor]
    forward: float
    backward: float


def drawing(device: str, count: int = GAUSSIANS, rounds: int = ROUNDS) -> Drawing:
    """Draw so many made-up Gaussians at 640x480 pixels."""
    leaves = Gaussians(*(one.detach().to(device).requires_grad_() for one in made_up(count).tensors()))
    weights = torch.randn(CAMERA.height, CAMERA.width, 3, generator=torch.Generator().manual_seed(1)).to(device)
    background, times = torch.zeros(3, device=device), []
    for _ in range(rounds + 1):
        started = _settled(device)
        image = rasterise(leaves, CAMERA, background).image
        drawn = _settled(device)
        gradients = torch.autograd.grad(image, leaves.tensors(), weights)
        times.append((1e3 * (drawn - started), 1e3 * (_settled(device) - drawn)))
    forward, backward = (median(part[1:]) for part in zip(*times, strict=True))
    return Drawing(image.detach().cpu(), [one.cpu() for one in gradients], forward, backward)


def _settled(device: str) -> float:
    """Seconds by the clock, once the device has done all that it was given."""
    if device != "cpu":
        torch.cuda.synchronize()
    return time.perf_counter()


def report_drawing() -> bool:
    """Print how both devices draw; whether they agree."""
    with reproducible(run_device("cuda")):
        here, there = drawing("cpu"), drawing("cuda")
    gaps = [float((one - two).norm() / one.norm()) for one, two in zip(here.gradients, there.gradients, strict=True)]
    off = (here.picture - there.picture).abs()
    jumps = float((off > 1e-3).double().mean())
    print(f"\n{GAUSSIANS:,} Gaussians at {CAMERA.width}x{CAMERA.height}, medians of {ROUNDS}, milliseconds:")
    for device, found in (("cpu", here), ("cuda", there)):
        print(f"{device}: picture {found.forward:.2f}, gradient {found.backward:.2f}")
    print(f"apart: picture {float(off.mean()):.1e}, numbers that jump {jumps:.1e}, gradient {max(gaps):.1e}")
    most = MOST[EXACT]
    return float(off.mean()) <= most.picture and jumps <= most.jumps and max(gaps) <= most.gradient


def timed(capture: Capture, options: TrainOptions) -> tuple[bytes, float, float]:
    """The file of a training, the PSNR of its last layer, and the milliseconds that an iteration took."""
    started = time.monotonic()
    trained = train(capture, options)
    spent = 1e3 * (time.monotonic() - started) / trained.iterations
    return trained.data, trained.layers[-1].psnr, spent


def report(capture: Capture, options: TrainOptions) -> bool:
    """Print all comparisons of one preset; whether everything is as it should be."""
    with reproducible(run_device("cuda")):
        errors = compared(capture, options)
    fine = all(found.within(MOST[what]) for what, found in errors.items())
    head = ("one iteration", "picture", "pixels that jump", "loss", "bits", "gradient", "of")
    figures = [[f"{value:.1e}" for value in list(vars(found).values())[:-1]] for found in errors.values()]
    rows = [[what, *shown, errors[what].parameter] for what, shown in zip(errors, figures, strict=True)]
    print(f"\n{options.preset}\n\n{table(head, rows)}\n")
    files = [timed(capture, replace(options, device=device)) for device in ("cpu", "cuda", "cuda")]
    for device, (data, psnr, spent) in zip(("cpu", "cuda", "cuda"), files, strict=True):
        print(f"{device}: {spent:.1f} ms an iteration, the file with it; {len(data):,} bytes, {psnr:.2f} dB")
    same = files[1][0] == files[2][0]
    anchors = len(decode_scene(files[1][0]))
    print(f"the GPU's file decodes to {anchors:,} anchors; again: {'the same bytes' if same else 'OTHER BYTES'}")
    return fine and same


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("capture", type=Path, help="photos with cameras")
    parser.add_argument("--resolution", type=int, default=RESOLUTION, help="longest side of the photos, pixels")
    parser.add_argument("--iterations", type=int, default=ITERATIONS, help="number of iterations of whole trainings")
    parser.add_argument("--preset", choices=PRESETS, help="only this preset [default: all]")
    chosen = parser.parse_args(arguments)
    try:
        run_device("cuda")
    except InvalidInput as refusal:
        print(f"SKIPPED, nothing was compared: {refusal}")
        return SKIPPED
    capture = load_capture(chosen.capture, resolution=chosen.resolution)
    print(f"{torch.cuda.get_device_name()}, torch {torch.__version__}: {len(capture.train)} photos")
    presets = PRESETS if chosen.preset is None else (chosen.preset,)
    options = [TrainOptions(iterations=chosen.iterations, preset=preset) for preset in presets]
    agree = report_drawing()
    return int(sum(not report(capture, each) for each in options) > 0 or not agree)


if __name__ == "__main__":
    sys.exit(main())

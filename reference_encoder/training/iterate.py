"""One iteration: a photo, a layer, a picture, what it lacks and what it costs, a step down."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from reference_encoder.training.curriculum import Moment
from reference_encoder.training.expand import Values, expanded, in_view
from reference_encoder.training.raster import Picture, rasterise
from reference_encoder.training.rate import Rate, rate
from reference_encoder.training.similarity import Target, dissimilarity
from reference_encoder.training.state import WEIGHT_BITS, State
from scarfmt.render.camera import Camera

_VOLUME_WEIGHT = 0.01
"""Weight of the mean volume of Gaussians in the loss (Scaffold-GS §3.4)."""
_RATE_PART = 8
"""One anchor of so many is priced an iteration."""
_FADE = 0.998


@dataclass(frozen=True)
class Mode:
    """The mode of an iteration.

    Attributes:
        layer: 0-based.
        now: what is on.
        counts: what growth is decided by is counted.
        price: loss a bit; 0 while rate does not count.
        ssim_share: of 1 - SSIM in what a picture lacks.
        wander: standard deviation, world units, of the place from where networks look about that of the camera.
    """

    layer: int
    now: Moment
    counts: bool
    price: float
    ssim_share: float
    wander: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """The outcome of an iteration.

    Attributes:
        loss: without rate.
        gaussians: drawn from.
        bits: estimate for the whole layer, None while rate does not count.
    """

    loss: float
    gaussians: int
    bits: float | None


def _values(state: State, rows: Tensor, mode: Mode) -> Values:
    """Values of anchors `rows` in an iteration."""
    if not (mode.now.noisy or mode.now.rounded):
        return state.exact(rows)
    return state.of_layer(rows, mode.layer, mode.now)


def iterate(state: State, camera: Camera, target: Target, mode: Mode, background: Tensor) -> Outcome:
    """Find gradients for one photo; the step is the caller's."""
    anchors = state.anchors
    rows = in_view(state.frame.world(anchors.lattice), anchors.scaling, anchors.offsets, camera)
    bits_a_weight = WEIGHT_BITS if mode.now.rounded else None
    eye = torch.from_numpy(camera.centre)
    if mode.wander:
        eye = eye + mode.wander * torch.randn(3, generator=state.generator, dtype=torch.float64)
    made = expanded(_values(state, rows, mode), state.networks, eye, bits_a_weight)
    picture = rasterise(made.gaussians, camera, background)
    loss = dissimilarity(picture.image, target, mode.ssim_share)
    total = loss + _VOLUME_WEIGHT * made.gaussians.scales.prod(dim=1).mean()
    if state.vectors is not None and state.vectors.loss is not None:
        total = total + state.vectors.loss
    bits = None
    if mode.price > 0:
        drawn = torch.randperm(len(anchors), generator=state.noise, device=state.device)
        part = drawn[: max(1, len(anchors) // _RATE_PART)]
        whole = priced(state, part, mode).total * (len(anchors) / len(part))
        total = total + mode.price * whole
        bits = float(whole.detach())
    total.backward()  # type: ignore[no-untyped-call]
    _count(state, rows, made.rows, made.slots, picture, made.gaussians.opacities.detach(), mode)
    return Outcome(float(loss.detach()), len(made.rows), bits)


def priced(state: State, rows: Tensor, mode: Mode) -> Rate:
    """Bits of anchors `rows` in the layer of an iteration."""
    index_bits = 0.0 if state.vectors is None else state.vectors.index_bits(mode.layer)
    return rate(state.context, state.priced(rows, mode.layer, mode.now.rounded), index_bits)


@torch.no_grad()
def _count(
    state: State, visible: Tensor, rows: Tensor, slots: Tensor, picture: Picture, opacities: Tensor, mode: Mode
) -> None:
    if not mode.counts or picture.means.grad is None:
        return
    height, width, _ = picture.image.shape
    halves = picture.means.new_tensor([width / 2, height / 2])
    norms = torch.linalg.norm(picture.means.grad * halves, dim=1)
    state.statistics.weight *= _FADE
    state.statistics.add(visible, visible[rows], slots, norms, picture.shown, opacities, picture.weights)

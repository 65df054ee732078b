"""One iteration: a photo, a layer, a picture, what it lacks and what it costs, a step down."""

from __future__ import annotations

import torch
from torch import Tensor

from reference_encoder.training.exposure import expose, fit_exposure
from reference_encoder.training.fixed_order import mean
from reference_encoder.training.neural_gaussians import expand
from reference_encoder.training.photo_store import View
from reference_encoder.training.presets import Moment
from reference_encoder.training.raster import Picture, rasterise
from reference_encoder.training.rate import layer_bits
from reference_encoder.training.similarity import dissimilarity
from reference_encoder.training.state import WEIGHT_BITS, State

_VOLUME_WEIGHT = 0.01
"""Weight of the mean volume of Gaussians in the loss (Scaffold-GS §3.4)."""
_RATE_PART = 8
"""One anchor of so many that the layer shows is priced an iteration."""
_FADE = 0.998


def iterate(
    state: State, view: View, now: Moment, layer: int, price: float, camera_jitter: float, background: Tensor
) -> tuple[float, float | None]:
    """Find gradients for one photo; the step is the caller's.

    Args:
        view: the photo.
        now: what is on.
        layer: 0-based.
        price: loss a bit; 0 while rate does not count.
        camera_jitter: standard deviation, world units, of the place from where networks look about that of the camera.
        background: (3,) colour behind everything.

    Returns:
        The loss without rate, and the estimated bits of the whole layer, None while rate does not count.
    """
    camera = view.camera
    rows = state.in_view(camera, layer)
    bits_a_weight = WEIGHT_BITS if now.rounded else None
    eye = torch.from_numpy(camera.centre)
    if camera_jitter:
        eye = eye + camera_jitter * torch.randn(3, generator=state.generator, dtype=torch.float64)
    values = state.of_layer(rows, layer, now) if now.noisy or now.rounded else state.exact(rows)
    gaussians, owners, slots = expand(values, state.networks, eye, bits_a_weight)
    picture = rasterise(gaussians, camera, background)
    photo = view.photo(state.device)
    if now.exposes:
        fit_exposure(state.exposures, view.number, picture.image, photo)
    loss = dissimilarity(expose(state.exposures, view.number, picture.image), photo)
    total = loss + _VOLUME_WEIGHT * mean(gaussians.scales.prod(dim=1))
    if state.vectors is not None and state.vectors.loss is not None:
        total = total + state.vectors.loss
    bits = None
    if price > 0:
        showing = state.showing(layer)
        drawn = torch.randperm(len(showing), generator=state.noise, device=state.device)
        part = showing.index_select(0, drawn[: -(-len(showing) // _RATE_PART)])
        index_bits = 0.0 if state.vectors is None else state.vectors.index_bits(layer)
        part_bits = layer_bits(state.context, state.price(part, layer, now.rounded), index_bits)
        whole = part_bits * (len(showing) / max(len(part), 1))
        total = total + price * whole
        bits = float(whole.detach())
    total.backward()  # type: ignore[no-untyped-call]
    if now.gathers and layer == state.plan.count - 1:
        _count(state, rows, owners, slots, picture, gaussians.opacities.detach())
    return float(loss.detach()), bits


@torch.no_grad()
def _count(state: State, visible: Tensor, rows: Tensor, slots: Tensor, picture: Picture, opacities: Tensor) -> None:
    """Count what growth is decided by."""
    if picture.means.grad is None:
        return
    height, width, _ = picture.image.shape
    halves = picture.means.new_tensor([width / 2, height / 2])
    norms = torch.linalg.norm(picture.means.grad * halves, dim=1)
    state.statistics.weight *= _FADE
    state.statistics.add(visible, visible[rows], slots, norms, picture.shown, opacities, picture.weights)

"""A learned latent (paper §3.2) in the terms of the linear one: decoder network, integer codewords, choices.

What the file stores is the decoder and the codewords, so the projector's outputs are only a starting point:
each vector's latent becomes the one that the stored decoder maps closest to the vector. Coordinates of the
latent are chosen so that the decoder is, on average, an isometry. A squared distance between latents then is
the squared error it causes, which is what the choice of codewords and the latent channel minimise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from reference_encoder.latent.autoencoder import Autoencoder, AutoencoderOptions, Layers, Sampler, train
from reference_encoder.latent.linear import Latent, metric_roots
from reference_encoder.latent.rvq import RvqOptions, RvqResult, Vectors, quantise
from reference_encoder.tuning import CODEWORD_RANGE, DAMPING, FINEST_UNIT, LEAST_GAIN, METRIC_VECTORS, SEARCH_ROUNDS
from scarfmt.arrays import F32, F64, I64
from scarfmt.blocks.mlp import Linear, QuantisedMlp

_CHUNK = 8192


@dataclass(frozen=True)
class Whitened:
    """Vectors in the space where errors count equally in all directions, centred and of size about 1.

    Attributes:
        x: (N, D) float32 = ((vectors - centre) @ root) / scale.
        centre: (D,) float64.
        root, inverse: (D, D) float64, symmetric.
        scale: root mean square.
    """

    x: F32
    centre: F64
    root: F64
    inverse: F64
    scale: float


def whiten(vectors: F32, weight: F64, metric: F64 | None) -> Whitened:
    """(N, D) `vectors` ready for training; see `learned_latent` for the arguments."""
    width = vectors.shape[1]
    centre = (weight @ vectors.astype(np.float64)) / max(float(weight.sum()), 1e-300)
    root, inverse = (np.eye(width), np.eye(width)) if metric is None else metric_roots(metric)
    x = (vectors - centre) @ root
    energy = float(weight @ (x * x).sum(axis=1)) / max(float(weight.sum()), 1e-300) / width
    scale = max(float(np.sqrt(energy)), float(np.abs(centre @ root).max()) * FINEST_UNIT, 1e-12)
    return Whitened((x / scale).astype(np.float32), centre, root, inverse, scale)


def learned_latent(
    vectors: F32,
    weight: F64,
    classes: I64,
    tolerance: float,
    options: AutoencoderOptions,
    metric: F64 | None = None,
    report: Callable[[float], None] = lambda _fraction: None,
) -> tuple[Latent, RvqResult] | None:
    """Learned latents of (N, D) `vectors` and their codewords; None when nothing in them is worth sending.

    `Latent.values` are the best latents the decoder allows and `Latent.lost` the error they leave.
    `RvqResult.distortion` is measured through the stored decoder and, as for the linear latent, is what
    quantisation adds to `lost`. Same input, options and machine: same result.

    Args:
        weight: (N,) squared picture error per squared unit.
        classes: (N,) class of each anchor; the price of a code depends on it.
        tolerance: total squared picture error that is not worth a latent.
        metric: (D, D) positive definite: an error e counts weight * e^T metric e; without, the identity.
        report: told the fraction done.
    """
    space = whiten(vectors, weight, metric)
    energy = (weight[:, None] * (vectors @ space.root) ** 2).sum()
    if energy <= tolerance:
        return None
    trained = train(space.x, weight, options, lambda fraction: report(0.7 * fraction))
    latent, start = stored(trained, space, weight, options)
    chosen = choose(latent, start, space, weight, classes, options.rvq, lambda fraction: report(0.7 + 0.3 * fraction))
    return latent, chosen


def stored(
    trained: Autoencoder, space: Whitened, weight: F64, options: AutoencoderOptions
) -> tuple[Latent, tuple[F32, F32]]:
    """The decoder as stored, its best latents, and the trained codewords in units of the codeword lattice."""
    generator = torch.Generator().manual_seed(options.rvq.seed)
    values = best_latents(trained.decoder, space.x, trained.encoded, SEARCH_ROUNDS)
    basis = principal(trained.decoder, values, weight, generator)
    values = basis.latents(values)
    unit = max(float(np.percentile(np.abs(values), 99.9)) / CODEWORD_RANGE, FINEST_UNIT)
    decoder = _stored(basis.decoder(trained.decoder), unit, space, options.decoder_bits)
    values = best_latents(_whitened_layers(decoder, space), space.x, (values / unit).astype(np.float32), 1)
    heavy = (weight * (unit * space.scale) ** 2).astype(np.float32)
    latent = Latent(values, heavy, decoder, weight * _squared_error(decoder, values, space))
    start = (basis.latents(trained.coarse) / unit, basis.differences(trained.residual) / unit)
    return latent, (start[0].astype(np.float32), start[1].astype(np.float32))


def choose(
    latent: Latent,
    start: tuple[F32, F32],
    space: Whitened,
    weight: F64,
    classes: I64,
    options: RvqOptions,
    report: Callable[[float], None] = lambda _fraction: None,
) -> RvqResult:
    """Integer codewords and entropy-constrained choices; distortion as `learned_latent` says."""
    chosen = quantise(Vectors(latent.values, latent.weight, classes), options, report, start)
    return replace(chosen, distortion=_distortion(chosen, latent, space, weight))


@dataclass(frozen=True)
class Basis:
    """Coordinates in which the decoder is an isometry on average: z' = (z - centre) @ forward."""

    centre: F64
    forward: F64
    backward: F64

    def latents(self, z: NDArray[np.floating]) -> F32:
        """(n, d) of (n, d) latents."""
        return ((z - self.centre) @ self.forward).astype(np.float32)

    def differences(self, z: NDArray[np.floating]) -> F32:
        """(n, d) of (n, d) differences of latents."""
        return (z @ self.forward).astype(np.float32)

    def decoder(self, layers: Layers) -> Layers:
        """Layers that take latents in these coordinates."""
        (weights, biases), *others = layers
        return [(weights @ self.backward.T, biases + weights @ self.centre), *others]


def principal(layers: Layers, z: F32, weight: F64, generator: torch.Generator, centred: bool = True) -> Basis:
    """The decoder's mean metric made the identity, and its axes sorted by energy: trailing ones have short ranges.

    Args:
        layers: of the decoder of (N, d) latents `z`.
        weight: (N,) importance of a squared error.
        centred: whether the middle of `z` becomes 0; else 0 stays where it is.
    """
    drawn = Sampler(weight, generator).draw(METRIC_VECTORS)
    slopes = _slopes(_tensors(layers), torch.from_numpy(z)[drawn])[1].double()
    metric = torch.einsum("nij,nik->jk", slopes, slopes).numpy() / len(drawn)
    gains, axes = np.linalg.eigh(metric)
    kept = gains > max(float(gains.max()), 1e-300) * LEAST_GAIN
    gains, axes = np.sqrt(gains[kept]), axes[:, kept]
    centre = np.zeros(z.shape[1])
    if centred:
        centre = (weight @ z.astype(np.float64)) / weight.sum() if weight.sum() > 0 else z.mean(0, dtype=np.float64)
    spread = (z - centre) @ (axes * gains)
    turn = np.linalg.eigh((spread * weight[:, None]).T @ spread)[1][:, ::-1]
    return Basis(centre, (axes * gains) @ turn, turn.T @ (axes / gains).T)


def _stored(layers: Layers, unit: float, space: Whitened, bits: int) -> QuantisedMlp:
    """The decoder with weights of few bits, from lattice units to vectors."""
    first, last = layers[0], layers[-1]
    layers = [(first[0] * unit, first[1]), *layers[1:]]
    last = layers[-1]
    undo = space.inverse * space.scale
    layers[-1] = (undo @ last[0], undo @ last[1] + space.centre)
    return QuantisedMlp(tuple(Linear.quantised(weights, biases, bits=bits) for weights, biases in layers))


def _whitened_layers(decoder: QuantisedMlp, space: Whitened) -> Layers:
    """The stored decoder, from lattice units to whitened vectors."""
    layers = [(layer.matrix, layer.biases.astype(np.float64)) for layer in decoder.layers]
    weights, biases = layers[-1]
    root = space.root / space.scale
    layers[-1] = (root @ weights, root @ (biases - space.centre))
    return layers


def _tensors(layers: Layers) -> list[tuple[torch.Tensor, torch.Tensor]]:
    return [(torch.from_numpy(w).float(), torch.from_numpy(b).float()) for w, b in layers]


def _slopes(layers: list[tuple[torch.Tensor, torch.Tensor]], z: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """(n, D) outputs for (n, d) `z`, and their (n, D, d) Jacobians."""
    weights, biases = layers[0]
    y = z @ weights.T + biases
    slopes = weights.expand(len(z), -1, -1)
    for weights, biases in layers[1:]:
        slopes = weights @ (slopes * (y > 0)[:, :, None])
        y = y.clamp_min(0) @ weights.T + biases
    return y, slopes


def best_latents(layers: Layers, x: F32, start: F32, rounds: int) -> F32:
    """(N, d) latents that `layers` map closest to (N, D) `x`, by damped Gauss-Newton steps from `start`.

    A step that makes a vector's error larger is not taken. One round is exact for a linear decoder.
    """
    tensors = _tensors(layers)
    rounds = 1 if len(layers) == 1 else rounds
    parts = []
    for first in range(0, len(x), _CHUNK):
        target, z = torch.from_numpy(x[first : first + _CHUNK]), torch.from_numpy(start[first : first + _CHUNK])
        for _ in range(rounds):
            z = _gauss_newton(tensors, target, z)
        parts.append(z)
    return torch.cat(parts).numpy()


def _gauss_newton(layers: list[tuple[torch.Tensor, torch.Tensor]], x: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
    y, slopes = _slopes(layers, z)
    slopes, left = slopes.double(), (x - y).double()
    normal = slopes.transpose(1, 2) @ slopes
    damping = DAMPING * normal.diagonal(dim1=1, dim2=2).mean(1).clamp_min(1e-30)
    normal = normal + damping[:, None, None] * torch.eye(z.shape[1], dtype=torch.float64)
    step = torch.linalg.solve(normal, (slopes.transpose(1, 2) @ left[:, :, None]).squeeze(2))
    moved = (z.double() + step).float()
    better = ((x - _slopes(layers, moved)[0]) ** 2).sum(1) < (left**2).sum(1)
    return torch.where(better[:, None], moved, z)


def _squared_error(decoder: QuantisedMlp, z: NDArray[np.floating], space: Whitened) -> F64:
    """(N,) squared error of the decoded (N, d) `z` in the whitened space's own units."""
    (first, *others) = _whitened_layers(decoder, space)
    error = np.empty(len(z))
    for start in range(0, len(z), _CHUNK):
        part = slice(start, start + _CHUNK)
        y = z[part] @ first[0].T + first[1]
        for weights, biases in others:
            y = np.maximum(y, 0) @ weights.T + biases
        error[part] = ((y - space.x[part]) ** 2).sum(axis=1)
    return error * space.scale**2


def _distortion(chosen: RvqResult, latent: Latent, space: Whitened, weight: F64) -> F64:
    """(M + 1, N) what quantisation adds to `latent.lost` after 0..M stages."""
    z = np.zeros(latent.values.shape)
    rows = [_squared_error(latent.decoder, z, space)]
    for stage in range(chosen.indices.shape[1]):
        z += (chosen.residual if stage else chosen.coarse)[chosen.indices[:, stage]]
        rows.append(_squared_error(latent.decoder, z, space))
    return weight * np.stack(rows) - latent.lost

"""Features of anchors as codewords, when the paper's quantiser carries them (paper §3.2, §3.5, §3.6; SPEC §7.8, §7.9).

:func:`export_latents` moves latents to coordinates in which the decoder is an isometry on average: trailing dimensions
are then short to write, and errors of rounding count alike. What happens after it, in the last part of training and in
a decoder, sees these integers alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from reference_encoder.training.codebook import rank_codewords
from reference_encoder.training.fixed_order import mean, one_thread, product_over_rows
from reference_encoder.training.optimizer import moments, restore_moments
from reference_encoder.training.presets import Moment
from reference_encoder.training.quantiser import Quantiser
from reference_encoder.tuning import DECODER_BITS, FINEST_UNIT, LATENT_RANGE, LEAST_GAIN, METRIC_VECTORS
from scarfmt.arrays import F32, F64, I16
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.scene.model import Codebooks

Layers = list[tuple[F64, F64]]
"""Weights (out, in) and biases (out,) of each layer, ReLU between them."""
_LARGEST = 32767
"""Largest component of a codeword: sums of 8 stages stay below 2^20 (SPEC §9.2)."""
_RATE, _LAST_RATE = 1e-3, 1e-4
"""Learning rates of projector and decoder on their own loss, and when pictures move them and the books too."""
_MEMORY = 0.99
_ECVQ = 0.5
"""The price of a bit when codewords are chosen, as a share of the slope of distortion by bits of an ideal quantiser."""
_TURNS = 8
"""Looks at an anchor between two choices of its codewords: choosing takes several times as long as all else."""


@dataclass(frozen=True)
class Coordinates:
    """Lattice units of a file's latents, from those of a quantiser: z' = z @ forward / unit.

    Attributes:
        forward, backward: (d, d') and (d', d) float64, inverses of each other.
        unit: of the lattice.
    """

    forward: F64
    backward: F64
    unit: float

    def latents(self, z: NDArray[np.floating]) -> F32:
        """(n, d') float32 of (n, d)."""
        return (z @ self.forward / self.unit).astype(np.float32)

    def decoder(self, layers: Layers) -> Layers:
        """Layers that take latents in these coordinates."""
        (weights, biases), *others = layers
        return [(weights @ self.backward.T * self.unit, biases), *others]


@dataclass(frozen=True)
class ExportedLatents:
    """The latent of a scene, as a file holds it.

    Attributes:
        codebooks: integer codewords; those nobody uses are gone, the others numbered by falling use.
        decoder: from latents in lattice units to features.
        indices: (N, M) int16, 0 for stages an anchor does not receive.
        coordinates: of all that.
    """

    codebooks: Codebooks
    decoder: QuantisedMlp
    indices: I16
    coordinates: Coordinates


@torch.no_grad()
def export_latents(
    quantiser: Quantiser,
    f: torch.Tensor,
    indices: torch.Tensor,
    received: torch.Tensor,
    coordinates: Coordinates | None = None,
) -> ExportedLatents:
    """The integers of a trained quantiser; its own numbers stay as they are.

    Args:
        f: (N, D) features, N > 0.
        indices: (N, M) int64 codes, as chosen.
        received: (N,) stages that each anchor has in the last layer.
        coordinates: of an earlier export, that an index network has been trained in; None for the best.
    """
    frame = best_coordinates(quantiser, f, indices, received) if coordinates is None else coordinates
    books = [quantiser.book(number).words.cpu().numpy() for number in range(len(quantiser.books))]
    words = [np.clip(np.rint(frame.latents(book)), -_LARGEST, _LARGEST) for book in books]
    dimension = frame.forward.shape[1]
    coarse, residual, ranks = rank_codewords(words, indices.cpu().numpy(), received.cpu().numpy(), dimension)
    decoder = frame.decoder(_layers(quantiser.decoder))
    stored = QuantisedMlp(tuple(Linear.quantise(weights, biases, bits=DECODER_BITS) for weights, biases in decoder))
    return ExportedLatents(Codebooks(coarse, residual), stored, ranks, frame)


@torch.no_grad()
def best_coordinates(
    quantiser: Quantiser, f: torch.Tensor, indices: torch.Tensor, received: torch.Tensor
) -> Coordinates:
    """The coordinates in which latents are exported: an isometry on average, sorted by energy, with fine enough
    steps."""
    seen = quantiser.look_up(indices, received).cpu().numpy()
    forward, backward = principal_axes(_layers(quantiser.decoder), seen)
    reached = np.abs(np.concatenate([seen, quantiser.project(f).cpu().numpy()]) @ forward)
    books = [quantiser.book(number).words.cpu().numpy() for number in range(len(quantiser.books))]
    widest = float(np.abs(np.concatenate(books) @ forward).max())
    unit = max(float(np.percentile(reached, 99.9)) / LATENT_RANGE, widest / _LARGEST, FINEST_UNIT)
    return Coordinates(forward, backward, unit)


def principal_axes(layers: Layers, z: F32) -> tuple[F64, F64]:
    """Axes, (d, d') and back, in which a decoder is an isometry on average, sorted by energy: trailing ones are short.

    Args:
        layers: of the decoder of (N, d) latents `z`.
    """
    # Slopes are taken at latents drawn with one seed: a linear decoder has the same everywhere.
    draws = torch.rand(METRIC_VECTORS, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    drawn = (draws * len(z)).long().clamp_max(len(z) - 1)
    slopes = _slopes(layers, torch.from_numpy(z)[drawn]).double()
    metric = product_over_rows(slopes.flatten(0, 1), slopes.flatten(0, 1)).numpy() / len(drawn)
    gains, axes = np.linalg.eigh(metric)
    saved = gains > max(float(gains.max()), 1e-300) * LEAST_GAIN
    gains, axes = np.sqrt(gains[saved]), axes[:, saved]
    spread = torch.from_numpy(z @ (axes * gains))
    turn = np.linalg.eigh(product_over_rows(spread, spread).numpy())[1][:, ::-1]
    return (axes * gains) @ turn, turn.T @ (axes / gains).T


@one_thread()
def _slopes(layers: Layers, z: torch.Tensor) -> torch.Tensor:
    """(n, D, d) Jacobians of a decoder at (n, d) `z`."""
    (weights, biases), *others = [(torch.from_numpy(w).float(), torch.from_numpy(b).float()) for w, b in layers]
    y, slopes = z @ weights.T + biases, weights.expand(len(z), -1, -1)
    for weights, biases in others:
        slopes = weights @ (slopes * (y > 0)[:, :, None])
        y = y.clamp_min(0) @ weights.T + biases
    return slopes


def _layers(decoder: nn.Sequential) -> Layers:
    return [
        (part.weight.detach().cpu().double().numpy(), part.bias.detach().cpu().double().numpy())
        for part in decoder
        if isinstance(part, nn.Linear)
    ]


class VqFeatures:
    """The quantiser of a scene in training, its own optimiser, and what it does now.

    Args:
        quantiser: of M stages, on the device of the run.
        stages: how many of them each layer has.
        priced: whether codewords are chosen by distortion and bits in the hard phase.
    """

    def __init__(self, quantiser: Quantiser, stages: tuple[int, ...], priced: bool = True) -> None:
        self.quantiser, self.stages, self.priced = quantiser, stages, priced
        self.begun, self.opened = False, False
        self.distortion = 0.0
        self.loss: Tensor | None = None
        self.coordinates: Coordinates | None = None
        self._seen: tuple[Tensor, Tensor] | None = None
        self._chosen: Tensor | None = None
        self._turn = 0
        self._optimiser = torch.optim.Adam(list(quantiser.network_parameters()), lr=_RATE)

    def begin(self, latent: Tensor, weight: Tensor) -> None:
        """Fit projector and decoder to (N, D) features, and books to what they make of them; (N,) importance."""
        self.begun = True
        self.quantiser.fit(latent, weight)
        self.quantiser.start(self.quantiser.project(latent), weight)
        self._chosen = self._unknown(len(latent))

    def rearrange(self, rows: Tensor, fresh: int) -> None:
        """Keep anchors `rows`, and take in `fresh` ones."""
        if self._chosen is not None:
            self._chosen = torch.cat([self._chosen[rows], self._unknown(fresh)])

    def _unknown(self, count: int) -> Tensor:
        """(count, M) codewords of anchors that have none yet."""
        device = self.quantiser.uses.device
        return torch.full((count, self.quantiser.stages), -1, device=device)

    def open(self) -> None:
        """From now on pictures move books, projector and decoder."""
        self.opened = True
        self.quantiser.open_books()
        parameters = [*self.quantiser.network_parameters(), *self.quantiser.books.parameters()]
        self._optimiser = torch.optim.Adam(parameters, lr=_LAST_RATE)

    def features(self, latent: Tensor, rows: Tensor, layer: int, now: Moment | None) -> Tensor:
        """(n, D) features that a picture of a layer is made of.

        Args:
            latent: (n, D) continuous features.
            rows: (n,) int64 of which anchors.
            layer: 0-based.
            now: None for those of the file.
        """
        if now is None:
            with torch.no_grad():
                shown: Tensor = self.quantiser.decode(self.quantiser.look_up(self.codes(latent), self.stages[layer]))
                return shown
        indices = self._choose(latent.detach(), rows, self._price() if now.hard else 0.0)
        given = latent if now.hard else latent.detach()
        encoded = self.quantiser.project(given)
        quantised: Tensor
        quantised, self.loss = self.quantiser(given, encoded, indices, self.stages[layer])
        self._seen = encoded.detach(), indices
        if now.hard:
            return quantised
        shown = latent + now.beta * (quantised - latent).detach()
        saved: Tensor = now.feature_gradient * latent
        return saved + (shown - saved).detach()

    @torch.no_grad()
    def _choose(self, latent: Tensor, rows: Tensor, price: float) -> Tensor:
        """(n, M) int64 codewords of features, chosen now for anchors whose turn it is and for those that have none."""
        assert self._chosen is not None
        self._turn += 1
        indices = self._chosen[rows]
        due = ((rows + self._turn) % _TURNS == 0) | (indices[:, 0] < 0)
        encoded = self.quantiser.project(latent[due])
        indices[due] = self.quantiser.choose(encoded, self.quantiser.bits(), price)
        self._chosen[rows] = indices
        return indices

    def codes(self, latent: Tensor) -> Tensor:
        """(n, M) int64 codewords of (n, D) features, as the file has them."""
        with torch.no_grad():
            price = self._price() if self.opened else 0.0
            return self.quantiser.choose(self.quantiser.project(latent), self.quantiser.bits(), price)

    def index_bits(self, layer: int) -> float:
        """Bits of an anchor's indices in a layer, under tables of their frequencies."""
        uses = self.quantiser.uses
        entropy = -(uses * torch.log2(uses.clamp_min(1e-12))).sum(dim=1)
        return float(entropy[: self.stages[layer]].sum())

    def step(self) -> None:
        """One step of the quantiser's own optimiser, and of its books, after backward."""
        if self.loss is None or self._seen is None:
            return
        self._optimiser.step()
        self._optimiser.zero_grad(set_to_none=True)
        encoded, indices = self._seen
        if len(indices):
            left = encoded - self.quantiser.look_up(indices).detach()
            self.distortion = _MEMORY * self.distortion + (1 - _MEMORY) * float(mean(left.square().sum(dim=1)))
            self.quantiser.update(encoded, indices)
        self.loss = self._seen = None

    def _price(self) -> float:
        """Squared units of z that a bit is worth: a bit more of d dimensions takes 2 ln 2 / d of the distortion."""
        dimension = self.quantiser.book(0).words.shape[1]
        return _ECVQ * 2 * math.log(2) / dimension * self.distortion if self.priced else 0.0

    def checkpoint(self) -> dict[str, Any]:
        """For a checkpoint."""
        names = ("begun", "opened", "distortion", "coordinates")
        own = {name: getattr(self, name) for name in names}
        own |= {"chosen": self._chosen, "turn": self._turn, "moments": moments(self._optimiser)}
        return own | {"quantiser": self.quantiser.state_dict()}

    def resume(self, saved: dict[str, Any]) -> None:
        """Take up a checkpoint."""
        self.quantiser.load_state_dict(saved["quantiser"])
        self.begun, self.distortion, self.coordinates = saved["begun"], saved["distortion"], saved["coordinates"]
        chosen, self._turn = saved["chosen"], saved["turn"]
        self._chosen = None if chosen is None else chosen.to(self.quantiser.uses.device)
        if saved["opened"]:
            self.open()
        restore_moments(self._optimiser, saved["moments"])

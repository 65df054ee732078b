"""Export of a trained latent as the integers of a file: codewords, indices, decoder (SPEC §7.8, §7.9, §9.2).

`export` moves latents to coordinates in which the decoder is an isometry on average, as the post-hoc encoder has them:
trailing dimensions are then short to write, and errors of rounding count alike. What happens after it, in the last part
of training and in a decoder, sees these integers alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from reference_encoder.latent.autoencoder import Layers
from reference_encoder.latent.learned import principal
from reference_encoder.latent.rvq import ranked
from reference_encoder.training.quantiser import Quantiser
from reference_encoder.tuning import CODEWORD_RANGE, DECODER_BITS, FINEST_UNIT
from scarfmt.arrays import F32, F64, I16, I64
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.scene.codebooks import Codebooks

_LARGEST = 32767
"""Largest component of a codeword: sums of 8 stages stay below 2^20 (SPEC §9.2)."""


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
class Exported:
    """The latent of a scene, as a file holds it.

    Attributes:
        codebooks: integer codewords; those nobody uses are gone, the others numbered by falling use.
        decoder: from latents in lattice units to features.
        indices: (N, M) int16, 0 for stages an anchor does not receive.
        latents: (N, d) float32 outputs of the projector in lattice units: what a LATENT channel may refine towards.
        coordinates: of all that.
    """

    codebooks: Codebooks
    decoder: QuantisedMlp
    indices: I16
    latents: F32
    coordinates: Coordinates

    def features(self, stages: I64) -> F32:
        """(N, D) float32 features after (N,) stages, without a LATENT channel (SPEC §9.2, §9.6)."""
        sums = self.codebooks.latents(self.indices.astype(np.int64), stages)
        return np.asarray(self.decoder.apply(sums.astype(np.float32)), np.float32)


@torch.no_grad()
def export(
    quantiser: Quantiser,
    f: torch.Tensor,
    indices: torch.Tensor,
    received: torch.Tensor,
    coordinates: Coordinates | None = None,
    bits: int = DECODER_BITS,
) -> Exported:
    """The integers of a trained quantiser; its own numbers stay as they are.

    Args:
        f: (N, D) features, N > 0.
        indices: (N, M) int64 codes, as chosen.
        received: (N,) stages that each anchor has in the last layer.
        coordinates: of an earlier export, that an index network has been trained in; None for the best.
        bits: of a weight of the decoder, 2..16.
    """
    found = best_coordinates(quantiser, f, indices, received) if coordinates is None else coordinates
    books = [found.latents(quantiser.book(k).words.cpu().numpy()) for k in range(len(quantiser.books))]
    words = [np.clip(np.rint(book), -_LARGEST, _LARGEST) for book in books]
    latents = found.latents(quantiser.project(f).cpu().numpy())
    coarse, residual, ranks = ranked(words, indices.cpu().numpy(), received.cpu().numpy(), latents.shape[1])
    decoder = found.decoder(_layers(quantiser.decoder))
    stored = QuantisedMlp(tuple(Linear.quantised(weights, biases, bits=bits) for weights, biases in decoder))
    return Exported(Codebooks(coarse, residual), stored, ranks, latents, found)


@torch.no_grad()
def best_coordinates(
    quantiser: Quantiser, f: torch.Tensor, indices: torch.Tensor, received: torch.Tensor
) -> Coordinates:
    """The coordinates in which latents are exported: an isometry on average, sorted by energy, with fine enough
    steps."""
    seen = quantiser.look_up(indices, received).cpu().numpy()
    # Slopes are taken at latents drawn with one seed: a linear decoder has the same everywhere.
    generator, layers = torch.Generator().manual_seed(0), _layers(quantiser.decoder)
    basis = principal(layers, seen, np.ones(len(seen)), generator, centred=False)
    reached = np.abs(np.concatenate([seen, quantiser.project(f).cpu().numpy()]) @ basis.forward)
    books = [quantiser.book(number).words.cpu().numpy() for number in range(len(quantiser.books))]
    widest = float(np.abs(np.concatenate(books) @ basis.forward).max())
    unit = max(float(np.percentile(reached, 99.9)) / CODEWORD_RANGE, widest / _LARGEST, FINEST_UNIT)
    return Coordinates(basis.forward, basis.backward, unit)


def _layers(decoder: nn.Sequential) -> Layers:
    return [
        (part.weight.detach().cpu().double().numpy(), part.bias.detach().cpu().double().numpy())
        for part in decoder
        if isinstance(part, nn.Linear)
    ]


class FixedLatents(nn.Module):
    """The integers of a scene, and a decoder that goes on learning from them; its weights are always as stored.

    Args:
        exported: what is fixed, and the decoder to start from.
        bits: of a weight of the decoder, 2..16.
    """

    coarse: torch.Tensor
    residual: torch.Tensor
    indices: torch.Tensor

    def __init__(self, exported: Exported, bits: int = DECODER_BITS) -> None:
        super().__init__()
        self._bits = bits
        books, layers = exported.codebooks, exported.decoder.layers
        self.register_buffer("coarse", torch.from_numpy(books.coarse))
        self.register_buffer("residual", torch.from_numpy(books.residual))
        self.register_buffer("indices", torch.from_numpy(exported.indices.astype(np.int64)))
        self.weights = nn.ParameterList(torch.from_numpy(layer.matrix).float() for layer in layers)
        self.biases = nn.ParameterList(torch.from_numpy(layer.biases.copy()) for layer in layers)

    @classmethod
    def of_state(cls, state: Mapping[str, Any], bits: int = DECODER_BITS) -> FixedLatents:
        """A copy built from the `state_dict` of another, which gives the sizes."""
        books = Codebooks(state["coarse"].cpu().numpy(), state["residual"].cpu().numpy())
        count = sum(name.startswith("weights.") for name in state)
        pairs = [(state[f"weights.{n}"].cpu().numpy(), state[f"biases.{n}"].cpu().numpy()) for n in range(count)]
        decoder = QuantisedMlp(tuple(Linear.quantised(weights, biases, bits=bits) for weights, biases in pairs))
        indices = state["indices"].cpu().numpy().astype(np.int16)
        same = np.eye(books.dimension)
        latents = np.zeros((len(indices), books.dimension), np.float32)
        made = cls(Exported(books, decoder, indices, latents, Coordinates(same, same, 1.0)), bits)
        made.load_state_dict(dict(state))
        return made

    def forward(
        self, rows: torch.Tensor, stages: torch.Tensor | int, refined: torch.Tensor | None = None
    ) -> torch.Tensor:
        """(n, D) features of the anchors `rows`, (n,) int64, after `stages`, one number or (n,).

        Args:
            refined: (n, d) values of the LATENT channel, if there is one.
        """
        codes = self.indices[rows]
        kept = torch.as_tensor(stages, device=codes.device).expand(len(codes))
        total = torch.zeros(len(codes), self.coarse.shape[1], dtype=torch.int64, device=codes.device)
        for stage in range(codes.shape[1]):
            words = (self.residual if stage else self.coarse)[codes[:, stage]]
            total = total + words * (kept > stage)[:, None]
        z = total.float() if refined is None else total.float() + refined
        for number, layer in enumerate(self.stored().layers):
            shadow = self.weights[number]
            exact = torch.from_numpy(layer.matrix).to(shadow)
            z = (z.relu() if number else z) @ (shadow + (exact - shadow).detach()).T + self.biases[number]
        return z

    def stored(self) -> QuantisedMlp:
        """The decoder as a file holds it."""
        pairs = zip(self.weights, self.biases, strict=True)
        return QuantisedMlp(
            tuple(
                Linear.quantised(weights.detach().cpu().numpy(), biases.detach().cpu().numpy(), bits=self._bits)
                for weights, biases in pairs
            )
        )

"""The paper's RVQ-VAE: projector, residual quantiser with a dual codebook, decoder (paper §3.2, §3.3, §3.5, §3.6).

Trained per scene. Three phases as in the paper's curriculum: continuous; soft injection, in which the
decoder sees a growing share of the quantised latent; hard quantisation. Beyond the paper, each batch keeps a
random number of stages, as in SoundStream, so that every prefix of stages decodes well. Weights of vectors
become probabilities of being drawn, which has the expected gradient of a weighted loss with less noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from reference_encoder.latent.gradient import ESTIMATORS
from reference_encoder.latent.rvq import RvqOptions, nearest
from reference_encoder.tuning import (
    HARD_SHARE,
    INJECT_SHARE,
    KMEANS_ROUNDS,
    KMEANS_VECTORS_PER_CODE,
    LEARNED_DECAY,
    LEARNED_STALE_SHARE,
)
from scarfmt.arrays import F32, F64

Layers = list[tuple[F64, F64]]

_CHUNK = 65536


@dataclass(frozen=True)
class AutoencoderOptions:
    """How the autoencoder is built and trained. Defaults are what measured best (docs/decisions/0005-latent.md).

    `encode` sets `rvq` and `estimator` alone. `hidden`, `layer_norm`, `loss` and `commitment` are the paper's choices;
    only ablations (benchmarks/latent.py, benchmarks/ablation.py) and tests reach them.

    Attributes:
        rvq: codebook sizes, stages, seed, and the lambda and epochs of the final entropy-constrained pass.
        dimensions: d_z, at most the width of the vectors.
        hidden: width of the decoder's hidden layer; 0 makes the decoder linear.
        layer_norm: LayerNorm after the projector (paper §3.6).
        estimator: gradient through the quantiser, "rotation" or "straight-through".
        loss: reconstruction loss, "l1" (paper §3.5) or "l2".
        commitment: weight of the commitment loss, the paper's beta times lambda_commit.
        steps: optimiser steps.
        batch: vectors a step.
        learning_rate: of Adam, falling to 0 as a half cosine.
        decoder_bits: bits a stored decoder weight, 2..16.
    """

    rvq: RvqOptions
    dimensions: int = 32
    hidden: int = 0
    layer_norm: bool = False
    estimator: str = "rotation"
    loss: str = "l2"
    commitment: float = 0.25
    steps: int = 600
    batch: int = 4096
    learning_rate: float = 3e-3
    decoder_bits: int = 12


@dataclass(frozen=True)
class Autoencoder:
    """A trained autoencoder.

    Attributes:
        encoded: (N, d) float32 projector outputs.
        decoder: (weights (out, in), biases (out,)) of each layer, ReLU between them.
        coarse, residual: (n, d) float32 codewords, first the zero vector; no residual ones with a single stage.
    """

    encoded: F32
    decoder: Layers
    coarse: F32
    residual: F32


class VectorCodebook:
    """Codewords that follow the vectors they serve by exponential moving averages (paper §3.6)."""

    def __init__(self, words: torch.Tensor, generator: torch.Generator) -> None:
        self.words = words.clone()
        self.mass = torch.ones(len(words))
        self._total = words.clone()
        self._generator = generator

    @classmethod
    def from_kmeans(cls, x: torch.Tensor, codewords: int, generator: torch.Generator) -> VectorCodebook:
        """A codebook at the k-means centres of (n, d) `x`."""
        book = cls(x[torch.randint(len(x), (codewords,), generator=generator)], generator)
        for _ in range(KMEANS_ROUNDS):
            book.learn(x, book.nearest(x), decay=0.0)
        book.mass = torch.ones(codewords)
        book._total = book.words.clone()
        return book

    def nearest(self, x: torch.Tensor) -> torch.Tensor:
        """(n,) nearest codewords of (n, d) `x`."""
        return torch.from_numpy(nearest(x.detach().numpy(), self.words.numpy()))

    def learn(self, x: torch.Tensor, codes: torch.Tensor, decay: float = LEARNED_DECAY) -> None:
        """Move towards the (n, d) vectors `x` that chose `codes`, and revive stale codes."""
        # In units of the mean use, whatever the batch size.
        gain = (1 - decay) * len(self.words) / len(x)
        counts = torch.bincount(codes, minlength=len(self.words)).float()
        sums = torch.zeros_like(self.words).index_add_(0, codes, x)
        self.mass = decay * self.mass + gain * counts
        self._total = decay * self._total + gain * sums
        served = self.mass > 0
        self.words = torch.where(served[:, None], self._total / self.mass.clamp_min(1e-30)[:, None], self.words)
        stale = torch.nonzero(self.mass < LEARNED_STALE_SHARE).squeeze(1)
        if len(stale):
            self.words[stale] = x[torch.randint(len(x), (len(stale),), generator=self._generator)]
            self.mass[stale] = LEARNED_STALE_SHARE
            self._total[stale] = self.words[stale] * LEARNED_STALE_SHARE

    def with_zero(self) -> F32:
        """(n + 1, d) codewords after a zero vector, which costs few bits where little is visible."""
        return torch.cat([torch.zeros(1, self.words.shape[1]), self.words]).numpy()


class Sampler:
    """Draws vector numbers with probability in proportion to their weights; uniformly if all are zero."""

    def __init__(self, weight: F64, generator: torch.Generator) -> None:
        ends = torch.from_numpy(np.asarray(weight, np.float64)).cumsum(0)
        if not float(ends[-1]) > 0:
            ends = torch.arange(1, len(weight) + 1, dtype=torch.float64)
        self._ends, self._generator = ends, generator

    def draw(self, count: int) -> torch.Tensor:
        """(count,) int64, with replacement."""
        at = torch.rand(count, dtype=torch.float64, generator=self._generator) * self._ends[-1]
        return torch.searchsorted(self._ends, at, right=True).clamp_max(len(self._ends) - 1)


def _quantised(
    z: torch.Tensor, books: list[VectorCodebook], stages: int
) -> tuple[list[torch.Tensor], list[tuple[torch.Tensor, torch.Tensor]]]:
    """Sums of the codewords of 1.. stages, and what each stage saw and chose."""
    sums, seen = [], []
    total = torch.zeros_like(z)
    for stage in range(stages):
        book = books[min(stage, 1)]
        left = z - total
        codes = book.nearest(left)
        total = total + book.words[codes]
        sums.append(total)
        seen.append((left, codes))
    return sums, seen


def _learn(books: list[VectorCodebook], seen: list[tuple[torch.Tensor, torch.Tensor]]) -> None:
    """One moving-average update a codebook: the shared residual one learns from all its stages at once."""
    books[0].learn(*seen[0])
    if len(seen) > 1:
        books[1].learn(torch.cat([left for left, _ in seen[1:]]), torch.cat([codes for _, codes in seen[1:]]))


def _start_books(z: torch.Tensor, options: RvqOptions, generator: torch.Generator) -> list[VectorCodebook]:
    codewords = max(min(options.codewords - 1, len(z)), 1)
    books = [VectorCodebook.from_kmeans(z, codewords, generator)]
    if options.stages > 1:
        left = z - books[0].words[books[0].nearest(z)]
        books.append(VectorCodebook.from_kmeans(left, codewords, generator))
    return books


def _projector(width: int, options: AutoencoderOptions) -> nn.Sequential:
    parts: list[nn.Module] = [nn.Linear(width, min(options.dimensions, width))]
    if options.layer_norm:
        parts.append(nn.LayerNorm(min(options.dimensions, width)))
    return nn.Sequential(*parts)


def _decoder(width: int, options: AutoencoderOptions) -> nn.Sequential:
    inputs = min(options.dimensions, width)
    if not options.hidden:
        return nn.Sequential(nn.Linear(inputs, width))
    return nn.Sequential(nn.Linear(inputs, options.hidden), nn.ReLU(), nn.Linear(options.hidden, width))


def _in_chunks(network: nn.Module, x: torch.Tensor) -> torch.Tensor:
    with torch.no_grad():
        return torch.cat([network(x[first : first + _CHUNK]) for first in range(0, len(x), _CHUNK)])


def train(
    vectors: F32, weight: F64, options: AutoencoderOptions, report: Callable[[float], None] = lambda _fraction: None
) -> Autoencoder:
    """An autoencoder of (N, D) `vectors`, N > 0, that should have a root mean square near 1.

    Args:
        weight: (N,) importance of a squared error.
        report: told the fraction done.
    """
    # The layers draw their first weights from torch's global generator.
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(options.rvq.seed)
        projector, decoder = _projector(vectors.shape[1], options), _decoder(vectors.shape[1], options)
    generator = torch.Generator().manual_seed(options.rvq.seed)
    x, sampler = torch.from_numpy(vectors), Sampler(weight, generator)
    optimiser = torch.optim.Adam([*projector.parameters(), *decoder.parameters()], lr=options.learning_rate)
    schedule = torch.optim.lr_scheduler.LambdaLR(
        optimiser, lambda step: 0.5 + 0.5 * math.cos(math.pi * min(step / options.steps, 1.0))
    )
    books: list[VectorCodebook] = []
    for step in range(options.steps):
        done = step / options.steps
        if done >= INJECT_SHARE and not books:
            books = _fresh_books(projector, x, sampler, options.rvq, generator)
        share = min(max((done - INJECT_SHARE) / (HARD_SHARE - INJECT_SHARE), 0.0), 1.0)
        loss = _step_loss(x[sampler.draw(options.batch)], projector, decoder, books, share, options, generator)
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        schedule.step()
        report((step + 1) / options.steps)
    books = books or _fresh_books(projector, x, sampler, options.rvq, generator)
    residual = books[1].with_zero() if len(books) > 1 else np.zeros((0, books[0].words.shape[1]), np.float32)
    return Autoencoder(_in_chunks(projector, x).numpy(), _layers(decoder), books[0].with_zero(), residual)


def _fresh_books(
    projector: nn.Module, x: torch.Tensor, sampler: Sampler, options: RvqOptions, generator: torch.Generator
) -> list[VectorCodebook]:
    pool = min(options.codewords * KMEANS_VECTORS_PER_CODE, len(x))
    return _start_books(_in_chunks(projector, x[sampler.draw(pool)]), options, generator)


def _step_loss(
    x: torch.Tensor,
    projector: nn.Module,
    decoder: nn.Module,
    books: list[VectorCodebook],
    share: float,
    options: AutoencoderOptions,
    generator: torch.Generator,
) -> torch.Tensor:
    """Reconstruction and commitment loss of a batch (paper §3.5); the codebooks learn from it on the way."""
    z = projector(x)
    commitment = torch.zeros(())
    seen_by_decoder = z
    if books:
        sums, seen = _quantised(z.detach(), books, options.rvq.stages)
        _learn(books, seen)
        kept = int(torch.randint(options.rvq.stages, (), generator=generator))
        commitment = torch.nn.functional.mse_loss(z, sums[kept])
        seen_by_decoder = torch.lerp(z, ESTIMATORS[options.estimator](z, sums[kept]), share)
    distance = torch.nn.functional.l1_loss if options.loss == "l1" else torch.nn.functional.mse_loss
    return distance(decoder(seen_by_decoder), x) + options.commitment * commitment


def _layers(decoder: nn.Sequential) -> Layers:
    return [
        (part.weight.detach().numpy().astype(np.float64), part.bias.detach().numpy().astype(np.float64))
        for part in decoder
        if isinstance(part, nn.Linear)
    ]

"""A codebook that follows the vectors it serves by exponential moving averages (paper §3.6).

Codeword 0 is the zero vector and stays it: what adds nothing must be cheap to say. A codeword that is hardly used
restarts at a vector of the batch, as in SoundStream. On CUDA sums are reproducible under
``torch.use_deterministic_algorithms``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import nn

from reference_encoder.training.fixed_order import one_thread
from reference_encoder.tuning import KMEANS_ROUNDS, LEARNED_DECAY, LEARNED_STALE_SHARE
from scarfmt.arrays import F32, I16, I64

_CHUNK = 8192
"""Vectors whose distances to all codewords are held at a time."""


class Codebook(nn.Module):
    """(n, d) float32 codewords, how much each is used, and how often one restarted.

    Attributes:
        words: the codewords; without gradient until the quantiser opens its books.
        mass: (n,) float32 moving average of uses, in units of the mean use.
    """

    mass: torch.Tensor

    def __init__(self, codewords: int, dimension: int) -> None:
        super().__init__()
        self.words = nn.Parameter(torch.zeros(codewords, dimension), requires_grad=False)
        self.register_buffer("mass", torch.ones(codewords))

    def __len__(self) -> int:
        return len(self.words)

    @torch.no_grad()
    @one_thread()
    def nearest(self, x: torch.Tensor, prices: torch.Tensor | None = None) -> torch.Tensor:
        """(m,) int64 codes of least |x - e|^2 + price, the first of equals.

        Args:
            x: (m, d) float32.
            prices: (n,) what each code costs, in squared units of x; None for nothing.
        """
        half = self.words.square().sum(1) / 2
        if prices is not None:
            half = half + prices / 2
        parts = torch.split(x, _CHUNK)
        return torch.cat([torch.addmm(half, part, self.words.T, alpha=-1).argmin(1) for part in parts])

    @torch.no_grad()
    def fit(self, x: torch.Tensor, weight: torch.Tensor, generator: torch.Generator, fresh: bool = True) -> None:
        """Move to the weighted k-means centres of (m, d) `x`, m > 0; codewords without vectors stay or become 0.

        Args:
            weight: (m,) importance of a squared error.
            fresh: start from vectors drawn by weight and length; else from the codewords as they are.
        """
        if fresh:
            self.words.zero_()
            drawn = _draw(weight.sqrt() * x.norm(dim=1), len(self) - 1, generator)
            self.words[1 : 1 + len(drawn)] = x[drawn]
        for number in range(KMEANS_ROUNDS):
            codes = self.nearest(x)
            mass, sums = self._sums(x * weight[:, None], weight, codes)
            served = mass > 0
            self.words[served] = sums[served] / mass[served, None]
            self.words[0] = 0
            unused = torch.nonzero(torch.bincount(codes, minlength=len(self))[1:] == 0)[:, 0] + 1
            if len(unused) and number < KMEANS_ROUNDS - 2:
                worst = _draw(weight * (x - self.words[codes]).square().sum(1), len(unused), generator)
                self.words[unused[: len(worst)]] = x[worst]
        self.mass.fill_(1.0)

    @torch.no_grad()
    def learn(self, x: torch.Tensor, codes: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """Move towards the (m, d) vectors `x` that chose (m,) `codes`; restart codewords that are hardly used.

        Returns:
            (n,) bool, the codewords that restarted.
        """
        gain = (1 - LEARNED_DECAY) * len(self) / len(x)
        counts, sums = self._sums(x, torch.ones(len(x), device=x.device), codes)
        self.mass.mul_(LEARNED_DECAY).add_(counts, alpha=gain)
        # With sums = mass * word before and after, this is the average of sums and masses, in terms of words alone:
        # steps that a gradient takes in between last.
        towards = sums - counts[:, None] * self.words
        self.words.add_(towards * (gain / self.mass.clamp_min(1e-30))[:, None])
        stale = self.mass < LEARNED_STALE_SHARE
        stale[0] = False
        if count := int(stale.sum()):
            drawn = torch.randint(len(x), (count,), generator=generator).to(x.device)
            self.words[stale] = x[drawn]
            # As if it had been used like others: it has a while to find vectors of its own.
            self.mass[stale] = 1.0
        self.words[0] = 0
        return stale

    def _sums(self, x: torch.Tensor, weight: torch.Tensor, codes: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(n,) sums of (m,) `weight` and (n, d) sums of (m, d) `x` over the vectors of each code."""
        mass = torch.zeros_like(self.mass).index_add_(0, codes, weight)
        return mass, torch.zeros_like(self.words).index_add_(0, codes, x)


def _draw(chances: torch.Tensor, count: int, generator: torch.Generator) -> torch.Tensor:
    """At most `count` different numbers, drawn in proportion to (m,) `chances`; none that has no chance."""
    possible = min(count, int((chances > 0).sum()))
    if not possible:
        return torch.zeros(0, dtype=torch.int64, device=chances.device)
    return torch.multinomial(chances.double().cpu(), possible, generator=generator).to(chances.device)


def rank_codewords(books: Sequence[F32], indices: I64, received: I64, dimension: int) -> tuple[I64, I64, I16]:
    """Both books without unused codewords, numbered by falling use; and the (N, M) indices.

    Args:
        books: coarse and residual, as far as there are stages: (n, d) whole numbers.
        indices: (N, M) codes of all stages.
        received: (N,) stages that count; the indices of others become 0.
        dimension: d.
    """
    ranked: list[I64] = []
    out = np.zeros(indices.shape, np.int16)
    for number, book in enumerate(books):
        stages = range(1) if number == 0 else range(1, indices.shape[1])
        sent = {stage: np.flatnonzero(received > stage) for stage in stages}
        used = sum(
            (np.bincount(indices[sent[s], s], minlength=len(book)) for s in stages), np.zeros(len(book), np.int64)
        )
        order = np.argsort(-used, kind="stable")[: max(int((used > 0).sum()), 1)]
        rank = np.zeros(len(book), np.int16)
        rank[order] = np.arange(len(order), dtype=np.int16)
        for stage in stages:
            out[sent[stage], stage] = rank[indices[sent[stage], stage]]
        ranked.append(book[order].astype(np.int64))
    empty = np.zeros((0, dimension), np.int64)
    coarse, residual = [*ranked, empty, empty][:2]
    return coarse, residual, out

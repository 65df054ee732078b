"""Entropy-constrained residual vector quantisation with the paper's dual codebook (paper §3.2).

One coarse codebook for stage 1, one residual codebook shared by all later stages. Training: k-means start,
then exponential moving averages over batches with stale-code replacement; assignment minimises
weight * distance^2 + lambda * bits, with the bits each code costs in the anchor's class. Codewords are
rounded to the latent's integer lattice before the next stage looks at the residual, so every stage corrects
the rounding of those before it.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from reference_encoder.jit import compiled
from reference_encoder.loops import add_products, first_of_least

F32 = NDArray[np.float32]
I64 = NDArray[np.int64]

_CHUNK = 8192
"""Vectors that a thread takes at a time."""
_DECAY = 0.8
# A code whose moving count falls below this is stale and restarts at a badly served vector.
_STALE = 1.0
# A code that nobody uses is not free: this many virtual uses keep its price finite.
_PRIOR = 0.02
# A dimension of a codebook spans at most 16 bits (SPEC §7.8).
_FARTHEST = 32767


@dataclass(frozen=True)
class RvqOptions:
    """How the quantiser is trained.

    Attributes:
        codewords: size of each codebook, a power of two up to 4096.
        stages: M, 0..8.
        rate: lambda, in weighted squared error per bit.
        sample: vectors used for training.
        epochs: passes over the sample.
        seed: of everything random.
    """

    codewords: int
    stages: int
    rate: float
    sample: int = 65536
    epochs: int = 6
    seed: int = 0


@dataclass(frozen=True)
class RvqResult:
    """Codebooks and choices.

    Attributes:
        coarse, residual: (n, d) int64 codewords; unused ones dropped, most used first.
        indices: (N, M) int16.
        distortion: (M + 1, N) float64 weighted squared error after 0..M stages.
        bits: (M, N) float32 modelled cost of each index.
    """

    coarse: I64
    residual: I64
    indices: NDArray[np.int16]
    distortion: NDArray[np.float64]
    bits: F32


class _Coster:
    """Bits of each code in each class, from soft counts."""

    def __init__(self, codewords: int, classes: int) -> None:
        self.bits = torch.full((classes, codewords), float(np.log2(max(codewords, 2))))

    def update(self, codes: torch.Tensor, classes: torch.Tensor) -> None:
        count, size = self.bits.shape
        flat = torch.bincount(classes * size + codes, minlength=count * size).reshape(count, size).float()
        pooled = flat.sum(0, keepdim=True)
        # Each class leans on the pooled distribution until it has symbols of its own.
        mixed = flat + 4 * (pooled + _PRIOR) / (pooled.sum() + _PRIOR * size) + 1e-3
        self.bits = -torch.log2(mixed / mixed.sum(1, keepdim=True))


def assign(
    x: torch.Tensor, weight: torch.Tensor, classes: torch.Tensor, book: torch.Tensor, bits: torch.Tensor, rate: float
) -> torch.Tensor:
    """(n,) codes minimising weight * |x - e|^2 + rate * bits, with (classes, codes) `bits`; at rate 0 the nearest."""
    half, words = ((book * book).sum(1) / 2).numpy(), np.ascontiguousarray(-book.numpy().T)
    vectors, out = np.ascontiguousarray(x.detach().numpy()), np.empty(len(x), np.int64)
    # Twice the weight, because distances are halved; without a price all vectors count alike.
    heavy, kinds, prices = (2 * weight).numpy(), classes.numpy(), (bits * rate).numpy()
    if rate == 0:
        heavy, kinds, prices = np.ones(len(x), np.float32), np.zeros(len(x), np.int64), np.zeros((1, len(half)))
    prices = prices.astype(np.float32)

    def fill(first: int) -> None:
        part = slice(first, first + _CHUNK)
        _nearest(vectors[part], heavy[part], kinds[part], words, half, prices, out[part])

    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        list(pool.map(fill, range(0, len(x), _CHUNK)))
    return torch.from_numpy(out)


@compiled
def _nearest(x: F32, weight: F32, classes: I64, words: F32, half: F32, prices: F32, out: I64) -> None:
    """Fill `out` (n,) with codes of least weight * (half + x @ words) + price, words (d, k) and prices (classes, k)."""
    scores = np.empty(len(half), np.float32)
    for row in range(len(x)):
        scores[:] = half
        add_products(x[row], words, scores)
        price, factor = prices[classes[row]], weight[row]
        for k in range(len(scores)):
            scores[k] = scores[k] * factor + price[k]
        out[row] = first_of_least(scores)


def _train(
    x: torch.Tensor,
    weight: torch.Tensor,
    classes: torch.Tensor,
    options: RvqOptions,
    generator: torch.Generator,
    start: torch.Tensor | None,
) -> tuple[torch.Tensor, _Coster]:
    """A codebook (n, d) for the vectors `x`: k-means start, then EMA batches with stale-code replacement."""
    if start is None:
        importance = (weight * (x * x).sum(1)).sqrt() + 1e-20
        start = x[torch.multinomial(importance, min(options.codewords, len(x)), generator=generator)]
    book = start.clone()
    book[0] = 0
    coster = _Coster(len(book), int(classes.max()) + 1)
    mass = torch.zeros(len(book))
    total = torch.zeros_like(book)
    for epoch in range(options.epochs):
        codes = assign(x, weight, classes, book, coster.bits, options.rate if epoch else 0.0)
        uses = torch.bincount(codes, minlength=len(book)).float()
        keep = _DECAY if epoch > 1 else 0.0
        mass = keep * mass + torch.zeros(len(book)).index_add_(0, codes, weight)
        total = keep * total + torch.zeros_like(book).index_add_(0, codes, x * weight[:, None])
        served = mass > 0
        book = torch.where(served[:, None], total / mass.clamp_min(1e-30)[:, None], book)
        coster.update(codes, classes)
        stale = (uses < _STALE) & (torch.arange(len(book)) > 0)
        if epoch < options.epochs - 2 and bool(stale.any()):
            error = weight * ((x - book[codes]) ** 2).sum(1)
            worst = torch.topk(error, int(stale.sum())).indices
            book[stale], mass[stale] = x[worst], 0.0
            coster.bits[:, stale] = coster.bits.median()
        book[0] = 0
    return book, coster


def _sample(count: int, options: RvqOptions, generator: torch.Generator) -> torch.Tensor:
    if count <= options.sample:
        return torch.arange(count)
    return torch.randperm(count, generator=generator)[: options.sample]


def quantise(
    latents: F32,
    weight: F32,
    classes: I64,
    options: RvqOptions,
    report: Callable[[float], None] = lambda _fraction: None,
    start: tuple[F32, F32] | None = None,
) -> RvqResult:
    """Codebooks and indices for (N, d) `latents`, in units of the codeword lattice.

    Args:
        latents: (N, d) float32; codewords are rounded to integers.
        weight: (N,) float32 importance of a squared unit of error.
        classes: (N,) class of each anchor; the price of a code depends on it.
        report: told the fraction done.
        start: (n, d) coarse and residual codewords to start from, row 0 of each becomes the zero
            vector; without it, a k-means start. With no epochs they are used as they are.
    """
    generator = torch.Generator().manual_seed(options.seed)
    residual, w, kinds = torch.from_numpy(latents).clone(), torch.from_numpy(weight), torch.from_numpy(classes)
    chosen = _sample(len(residual), options, generator)
    books: list[torch.Tensor] = []
    codes: list[torch.Tensor] = []
    distortion = [(w * (residual * residual).sum(1)).double()]
    bits: list[torch.Tensor] = []
    for stage in range(options.stages):
        if stage < 2:
            copies = 2 if stage == 1 and options.stages > 2 else 1
            pool, heavy, kind = _pooled(residual[chosen], w[chosen], kinds[chosen], copies)
            first = None if start is None else torch.from_numpy(start[stage])
            book, coster = _train(pool, heavy, kind, options, generator, first)
            book = torch.round(book).clamp_(-_FARTHEST, _FARTHEST)
            books.append(book)
        coster = _settled(residual[chosen], w[chosen], kinds[chosen], book, coster, options)
        code = assign(residual, w, kinds, book, coster.bits, options.rate)
        residual = residual - book[code]
        codes.append(code)
        bits.append(coster.bits[kinds, code])
        distortion.append((w * (residual * residual).sum(1)).double())
        report((stage + 1) / options.stages)
    return _result(books, codes, distortion, bits, latents.shape)


def _settled(
    x: torch.Tensor, w: torch.Tensor, kinds: torch.Tensor, book: torch.Tensor, coster: _Coster, options: RvqOptions
) -> _Coster:
    """Code prices that agree with the choices they cause (two rounds on the sample)."""
    for _ in range(2):
        coster.update(assign(x, w, kinds, book, coster.bits, options.rate), kinds)
    return coster


def _pooled(
    residual: torch.Tensor, w: torch.Tensor, kinds: torch.Tensor, copies: int
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """What the shared residual codebook must serve: stage-2 residuals and, roughly, those of later stages.

    Later residuals look like earlier ones, only shorter; halved copies stand for them.
    """
    return torch.cat([residual / 2**k for k in range(copies)]), w.repeat(copies), kinds.repeat(copies)


def _result(
    books: list[torch.Tensor],
    codes: list[torch.Tensor],
    distortion: list[torch.Tensor],
    bits: list[torch.Tensor],
    shape: tuple[int, ...],
) -> RvqResult:
    """Drop codewords nobody uses and number the rest by falling use."""
    kept: list[I64] = []
    indices = np.zeros((shape[0], len(codes)), np.int16)
    for number, book in enumerate(books):
        stages = range(1) if number == 0 else range(1, len(codes))
        used = torch.stack([torch.bincount(codes[s], minlength=len(book)) for s in stages]).sum(0).numpy()
        order = np.argsort(-used, kind="stable")[: max(int((used > 0).sum()), 1)]
        rank = np.zeros(len(book), np.int16)
        rank[order] = np.arange(len(order), dtype=np.int16)
        for stage in stages:
            indices[:, stage] = rank[codes[stage].numpy()]
        kept.append(book.numpy()[order].astype(np.int64))
    empty = np.zeros((0, shape[1]), np.int64)
    coarse, residual = [*kept, empty, empty][:2]
    return RvqResult(
        coarse,
        residual,
        indices,
        np.stack([d.numpy() for d in distortion]),
        np.stack([b.numpy() for b in bits]) if bits else np.zeros((0, shape[0]), np.float32),
    )

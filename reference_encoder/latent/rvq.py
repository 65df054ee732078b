"""Entropy-constrained residual vector quantisation with the paper's dual codebook (paper §3.2).

One coarse codebook for stage 1, one residual codebook shared by all later stages. Training: k-means start,
then exponential moving averages over batches with stale-code replacement; assignment minimises
weight * distance^2 + lambda * bits, with the bits each code costs in the anchor's class. Codewords are
rounded to the latent's integer lattice before the next stage looks at the residual, so every stage corrects
the rounding of those before it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numba import get_num_threads

from reference_encoder.draws import Draws
from reference_encoder.jit import compiled
from reference_encoder.loops import add_products, first_of_least
from reference_encoder.sums import added_rows, row_sums, squared_lengths
from reference_encoder.tuning import RVQ_DECAY, RVQ_PRIOR_USES, RVQ_STALE_USES
from scarfmt.arrays import F32, F64, I16, I64
from scarfmt.engines import codeword_search

_CHUNK = 8192
"""Vectors that a thread takes at a time."""
# A dimension of a codebook spans at most 16 bits (SPEC §7.8).
_FARTHEST = 32767


@dataclass(frozen=True)
class RvqOptions:
    """How the quantiser is trained.

    Attributes:
        codewords: size of each codebook, a power of two up to 4096.
        stages: M, 0..8.
        lambda_: weighted squared error per bit.
        sample: vectors used for training.
        epochs: passes over the sample.
        seed: of everything random.
    """

    codewords: int
    stages: int
    lambda_: float
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
    indices: I16
    distortion: F64
    bits: F32


class Prices:
    """Bits of each code in each class, from soft counts.

    Attributes:
        bits: (classes, codewords) float32.
    """

    def __init__(self, codewords: int, classes: int) -> None:
        self.bits = np.full((classes, codewords), np.log2(max(codewords, 2)), np.float32)

    def update(self, codes: I64, classes: I64) -> None:
        """Estimate the bits from the use of (n,) codes in (n,) classes."""
        count, size = self.bits.shape
        flat = np.bincount(classes * size + codes, minlength=count * size).reshape(count, size).astype(np.float32)
        pooled = flat.sum(axis=0, keepdims=True)
        # Each class leans on the pooled distribution until it has symbols of its own.
        mixed = flat + 4 * (pooled + RVQ_PRIOR_USES) / (pooled.sum() + RVQ_PRIOR_USES * size) + np.float32(1e-3)
        # By way of binary64: logarithms of binary32 differ from library to library.
        self.bits = (-np.log2((mixed / row_sums(mixed)[:, None]).astype(np.float64))).astype(np.float32)


@dataclass(frozen=True)
class Vectors:
    """Vectors to quantise.

    Attributes:
        x: (n, d) float32.
        weight: (n,) float32 importance of a squared unit of error.
        classes: (n,) int64; the price of a code depends on it.
    """

    x: F32
    weight: F32
    classes: I64

    def take(self, chosen: I64) -> Vectors:
        """The vectors numbered `chosen`."""
        return Vectors(self.x[chosen], self.weight[chosen], self.classes[chosen])

    def less(self, codewords: F32) -> Vectors:
        """The vectors minus (n, d) `codewords`."""
        return Vectors(self.x - codewords, self.weight, self.classes)

    @property
    def energy(self) -> F32:
        """(n,) float32 weight * |x|^2."""
        return self.weight * squared_lengths(self.x)


def nearest(x: F32, book: F32) -> I64:
    """(n,) codes of the codewords of (k, d) `book` nearest to (n, d) `x`."""
    alike = Vectors(x, np.full(len(x), 0.5, np.float32), np.zeros(len(x), np.int64))
    return _assigned(alike, book, np.zeros((1, len(book)), np.float32))


def assign(vectors: Vectors, book: F32, bits: F32, lambda_: float) -> I64:
    """(n,) codes of (k, d) `book` minimising weight * |x - e|^2 + lambda * bits, with (classes, k) `bits`."""
    return _assigned(vectors, book, bits * np.float32(lambda_)) if lambda_ else nearest(vectors.x, book)


def _assigned(vectors: Vectors, book: F32, prices: F32) -> I64:
    half, words = np.asarray(squared_lengths(book) / 2, np.float32), np.ascontiguousarray(-book.T)
    x, out = np.ascontiguousarray(vectors.x), np.empty(len(vectors.x), np.int64)
    # Twice the weight, because distances are halved.
    heavy, classes = 2 * vectors.weight, vectors.classes
    search = _search(words, half, prices)

    def fill(first: int) -> None:
        part = slice(first, first + _CHUNK)
        search(x[part], heavy[part], classes[part], out[part])

    with ThreadPoolExecutor(get_num_threads()) as pool:
        list(pool.map(fill, range(0, len(x), _CHUNK)))
    return out


def _search(words: F32, half: F32, prices: F32) -> Callable[[F32, F32, I64, I64], None]:
    """The search of (d, k) negated `words` and (classes, k) `prices`; by the compiled kernel where there is one."""
    compiled_search = codeword_search(words, half, prices)
    if compiled_search is not None:
        return compiled_search
    return lambda x, weight, classes, out: _fill_nearest(x, weight, classes, words, half, prices, out)


@compiled
def _fill_nearest(x: F32, weight: F32, classes: I64, words: F32, half: F32, prices: F32, out: I64) -> None:
    """Fill `out` (n,) with codes of least weight * (half + x @ words) + price, words (d, k) and prices (classes, k)."""
    scores = np.empty(len(half), np.float32)
    for row in range(len(x)):
        scores[:] = half
        add_products(x[row], words, scores)
        price, factor = prices[classes[row]], weight[row]
        for k in range(len(scores)):
            scores[k] = scores[k] * factor + price[k]
        out[row] = first_of_least(scores)


def _train(vectors: Vectors, options: RvqOptions, draws: Draws, start: F32 | None) -> tuple[F32, Prices]:
    """A codebook (n, d) for `vectors`: k-means start, then EMA batches with stale-code replacement."""
    if start is None:
        importance = np.sqrt(vectors.energy) + np.float32(1e-20)
        start = vectors.x[draws.weighted(importance, min(options.codewords, len(importance)))]
    book = start.copy()
    book[0] = 0
    prices = Prices(len(book), int(vectors.classes.max()) + 1)
    mass, total = np.zeros((len(book), 1), np.float32), np.zeros_like(book)
    weight = vectors.weight[:, None]
    for epoch in range(options.epochs):
        codes = assign(vectors, book, prices.bits, options.lambda_ if epoch else 0.0)
        keep = np.float32(RVQ_DECAY if epoch > 1 else 0.0)
        mass = keep * mass + added_rows(codes, weight, len(book))
        total = keep * total + added_rows(codes, vectors.x * weight, len(book))
        book = np.where(mass > 0, total / np.maximum(mass, np.float32(1e-30)), book)
        prices.update(codes, vectors.classes)
        stale = np.bincount(codes, minlength=len(book)) < RVQ_STALE_USES
        stale[0] = False
        if epoch < options.epochs - 2 and stale.any():
            book[stale], mass[stale] = vectors.x[_worst_served(vectors, book[codes], int(stale.sum()))], 0.0
            prices.bits[:, stale] = _lower_median(prices.bits)
        book[0] = 0
    return book, prices


def _lower_median(values: F32) -> np.float32:
    return np.float32(np.sort(values, axis=None)[(values.size - 1) // 2])


def _worst_served(vectors: Vectors, words: F32, count: int) -> I64:
    """The `count` vectors with the largest weighted errors under (n, d) `words`, the worst first."""
    return np.argsort(-vectors.less(words).energy, kind="stable")[:count]


def quantise(
    vectors: Vectors,
    options: RvqOptions,
    report: Callable[[float], None] = lambda _fraction: None,
    start: tuple[F32, F32] | None = None,
) -> RvqResult:
    """Codebooks and indices for `vectors`, in units of the codeword lattice: codewords are integers.

    Args:
        report: told the fraction done.
        start: (n, d) coarse and residual codewords to start from, row 0 of each becomes the zero
            vector; without it, a k-means start. With no epochs they are used as they are.
    """
    draws, left = Draws(options.seed), vectors
    chosen = _sample(len(vectors.x), options, draws)
    books, codes, bits = [], [], []
    distortion = [vectors.energy.astype(np.float64)]
    for stage in range(options.stages):
        sample = left.take(chosen)
        if stage < 2:
            copies = 2 if stage == 1 and options.stages > 2 else 1
            book, prices = _train(_pooled(sample, copies), options, draws, None if start is None else start[stage])
            book = np.clip(np.round(book), -_FARTHEST, _FARTHEST)
            books.append(book)
        _settle(prices, sample, book, options.lambda_)
        code = assign(left, book, prices.bits, options.lambda_)
        left = left.less(book[code])
        codes.append(code)
        bits.append(prices.bits[vectors.classes, code])
        distortion.append(left.energy.astype(np.float64))
        report((stage + 1) / options.stages)
    indices = np.stack(codes, axis=1) if codes else np.zeros((len(vectors.x), 0), np.int64)
    coarse, residual, ranks = ranked(books, indices, np.full(len(indices), options.stages), vectors.x.shape[1])
    none = np.zeros((0, len(vectors.x)), np.float32)
    return RvqResult(coarse, residual, ranks, np.stack(distortion), np.stack(bits) if bits else none)


def _sample(count: int, options: RvqOptions, draws: Draws) -> I64:
    return np.arange(count) if count <= options.sample else draws.permutation(count)[: options.sample]


def _settle(prices: Prices, sample: Vectors, book: F32, lambda_: float) -> None:
    """Make code prices agree with the choices they cause (two rounds on the sample)."""
    for _ in range(2):
        prices.update(assign(sample, book, prices.bits, lambda_), sample.classes)


def _pooled(sample: Vectors, copies: int) -> Vectors:
    """The training vectors of the shared residual codebook: residuals of stage 2 and, roughly, those of later stages.

    Later residuals look like earlier ones, only shorter; halved copies stand for them.
    """
    x = np.concatenate([sample.x / np.float32(2**k) for k in range(copies)])
    return Vectors(x, np.tile(sample.weight, copies), np.tile(sample.classes, copies))


def ranked(books: Sequence[F32], indices: I64, received: I64, dimension: int) -> tuple[I64, I64, I16]:
    """Both books without unused codewords, numbered by falling use; and the (N, M) indices.

    Args:
        books: coarse and residual, as far as there are stages: (n, d) whole numbers.
        indices: (N, M) codes of all stages.
        received: (N,) stages that count; the indices of others become 0.
        dimension: d.
    """
    kept: list[I64] = []
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
        kept.append(book[order].astype(np.int64))
    empty = np.zeros((0, dimension), np.int64)
    coarse, residual = [*kept, empty, empty][:2]
    return coarse, residual, out

"""Networks and streams of the entropy model that are measured: synthetic, of the shapes that files have.

A rANS decoder that is fed random words draws symbols from the very probabilities it is given: so any network can be
timed on symbols as surprising as it expects them to be, without training it or encoding anything.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from scarfmt.arrays import F32, I64
from scarfmt.entropy.rans import SymbolSource
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.evaluator import Block, Evaluator
from scarfmt.neural.network import Head, Inputs
from tests.neural.networks import Case, random_books, random_network

INPUTS = Inputs(classes=8, own=True, attributes=11, depths=2, latents=16, latent_shift=0, grid=30)
_DIMENSION, _CODEWORD_DIMS, _CLUSTER = 40, 24, 32
_BITS = 9
_WEIGHT = 20


@dataclass(frozen=True)
class Shape:
    """A network as the encoder makes them.

    Attributes:
        stages: of the scene.
        hidden: H; the embedding's first layer and the mixer are twice as wide.
        words: codewords of each codebook.
        two_level: clusters of 32 codewords; else flat.
        attention: over earlier states.
    """

    stages: int
    hidden: int
    words: int = 1024
    two_level: bool = True
    attention: bool = False

    @property
    def name(self) -> str:
        """The name in tables."""
        head = f"{self.words // _CLUSTER} x {_CLUSTER}" if self.two_level else f"flat {self.words}"
        return f"{head}, {self.stages} stages, H = {self.hidden}" + (", attention" if self.attention else "")


def make_case(shape: Shape, seed: int = 0) -> Case:
    """A valid network of a shape, with its codebooks."""
    rng = np.random.default_rng(seed)
    books = random_books(rng, shape.words, shape.words, _DIMENSION)
    network = random_network(
        rng, books, INPUTS, stages=shape.stages, hidden=shape.hidden, mixed=2 * shape.hidden, activation_bits=_BITS,
        two_level=shape.two_level, attention=shape.attention, codeword_dims=_CODEWORD_DIMS,
        cluster_size=_CLUSTER if shape.two_level else None,
    )  # fmt: skip
    wide = 2 * shape.hidden
    embed = _layer(rng, wide, INPUTS.width), _layer(rng, shape.hidden, wide)
    network = replace(network, embed=embed)
    network.check(books, shape.stages)
    return Case(books, shape.stages, network)


def _layer(rng: np.random.Generator, rows: int, columns: int) -> Linear:
    """Outputs of about the size of the inputs."""
    weights = rng.integers(-_WEIGHT, _WEIGHT + 1, (rows, columns)).astype(np.int32)
    shift = round(float(np.log2(0.58 * _WEIGHT * np.sqrt(columns))))
    return Linear(weights, rng.integers(-1000, 1001, rows), shift)


@dataclass(frozen=True)
class Batch:
    """Anchors coded together: one pass of a tile, with the words its symbols are read from.

    Attributes:
        x: (n, width) float32 inputs.
        words: bytes of a rANS stream longer than all symbols need.
    """

    x: F32
    words: bytes


def make_batch(case: Case, count: int, seed: int) -> Batch:
    """Random inputs and words for `count` anchors."""
    rng = np.random.default_rng(seed)
    amax = case.network.amax
    x = rng.integers(-amax, amax + 1, (count, case.network.inputs.width)).astype(np.float32)
    # A symbol takes less than 24 bits, and there are at most two an index.
    return Batch(x, rng.integers(1, 1 << 32, 2 * case.stages * count, dtype=np.uint64).astype("<u4").tobytes())


class Clock:
    """Seconds of processor time of each part of one thread's work, by name: other programs do not count."""

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Time what is done within."""
        start = time.thread_time()
        yield
        self.seconds[name] += time.thread_time() - start

    def each(self, name: str, blocks: Iterator[Block]) -> Iterator[Block]:
        """`blocks`, timing what makes them."""
        while True:
            with self.part(name):
                block = next(blocks, None)
            if block is None:
                return
            yield block


def decode_batch(evaluator: Evaluator, case: Case, x: F32, source: SymbolSource, clock: Clock) -> I64:
    """(stages, n) indices of the anchors of one pass, as :mod:`scarfmt.codecs.neural_indices` reads them."""
    with clock.part("embed"):
        h = evaluator.embed(x)
    state = evaluator.start(len(x))
    out = np.empty((case.stages, len(x)), np.int64)
    for stage in range(1, case.stages + 1):
        with clock.part("context"):
            y = evaluator.mixed(h, state)
        out[stage - 1] = _decode_stage(evaluator, case.network.heads[int(stage > 1)], int(stage > 1), y, source, clock)
        if stage < case.stages:
            with clock.part("advance"):
                state = evaluator.advance(state, stage, out[stage - 1])
    return out


def _decode_stage(evaluator: Evaluator, head: Head, book: int, y: F32, source: SymbolSource, clock: Clock) -> I64:
    first = np.empty(len(y), np.int64)
    for block in clock.each("first rows", evaluator.first_blocks(book, y)):
        with clock.part("rANS"):
            first[block.rows] = source.decode_rows(block.weights())
    if not head.two_level:
        return first
    codes = np.asarray(head.starts[first])
    for block in clock.each("member rows", evaluator.member_blocks(book, y, first)):
        with clock.part("rANS"):
            codes[block.rows] += source.decode_rows(block.weights())
    return codes

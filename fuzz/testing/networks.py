"""Random valid index networks, for every test that needs one (SPEC §10.5)."""

from __future__ import annotations

import numpy as np

from conformance.scenes.neural_models import NetworkPlan, network_of
from scarfmt.neural.arithmetic import ACCUMULATOR_LIMIT, amplitude
from scarfmt.neural.network import IndexNetwork, Inputs
from scarfmt.scene.model import Codebooks


def random_books(rng: np.random.Generator, coarse: int, residual: int, dimension: int) -> Codebooks:
    """Codewords of falling range, as a decorrelated latent has them."""
    scale = 400 / (1 + np.arange(dimension))
    words = [np.rint(rng.normal(size=(n, dimension)) * scale * part) for n, part in ((coarse, 1), (residual, 0.5))]
    return Codebooks(words[0].astype(np.int64), words[1].astype(np.int64))


def random_network(
    rng: np.random.Generator,
    books: Codebooks,
    inputs: Inputs,
    *,
    stages: int = 3,
    hidden: int = 8,
    activation_bits: int = 10,
    attention: bool = True,
    gru_layers: int = 1,
    mixed: int | None = None,
    codeword_dims: int | None = None,
    edge: bool = False,
    pre_activation: float = 96,
) -> IndexNetwork:
    """A valid network whose activations are neither all zero nor all clamped.

    Args:
        mixed: Y, by default `hidden`.
        codeword_dims: R, by default up to 6 of the latent's dimensions.
        edge: biases bring every accumulator to exactly the largest reach allowed.
        pre_activation: typical size of the recurrent layers' products; tanh and sigmoid end at 255.
    """
    dims = min(books.dimension, 6) if codeword_dims is None else codeword_dims
    words = [book for book in (books.coarse, books.residual) if len(book)]
    widths = hidden + 1, hidden, hidden if mixed is None else mixed
    plan = NetworkPlan(activation_bits, widths, dims, gru_layers, gate=int(pre_activation),
                       attention=attention, edge=edge)  # fmt: skip
    shift = _codeword_shift([book[:, :dims] for book in words], amplitude(activation_bits))
    network = network_of(rng, plan, inputs, books, stages - 1, shift)
    network.check(books, stages)
    return network


def _codeword_shift(books: list[np.ndarray], amax: int) -> int:
    """Least shift that keeps logits, well below the limit."""
    for shift in range(24):
        e = [np.clip(book >> shift, -amax, amax) for book in books]
        if max(int((2 * np.abs(words) + 2).sum(axis=1).max()) for words in e) * amax < ACCUMULATOR_LIMIT // 4:
            return shift
    raise AssertionError("codewords that fit no shift")

"""Random valid index networks as Hypothesis cases; `fuzz.testing` publishes what makes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from fuzz.testing.networks import random_books, random_network
from scarfmt.neural.network import IndexNetwork, Inputs
from scarfmt.scene.model import Codebooks

__all__ = ["Case", "cases", "random_books", "random_network"]


@dataclass(frozen=True)
class Case:
    """A network with all it is used with."""

    books: Codebooks
    stages: int
    network: IndexNetwork


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Valid networks of every kind, small enough for the oracle."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    stages = draw(st.integers(1, 4))
    sizes = draw(st.integers(1, 12)), draw(st.integers(1, 12)) if stages > 1 else 0
    books = random_books(rng, *sizes, draw(st.integers(1, 5)))
    inputs = Inputs(
        classes=draw(st.integers(0, 3)), own=draw(st.booleans()), attributes=draw(st.integers(1, 4)),
        depths=draw(st.integers(1, 2)), latents=draw(st.integers(0, 1)), latent_shift=2, grid=draw(st.integers(0, 4)),
    )  # fmt: skip
    network = random_network(
        rng, books, inputs, stages=stages, hidden=draw(st.integers(1, 9)), mixed=draw(st.integers(1, 7)),
        activation_bits=draw(st.integers(8, 12)), attention=draw(st.booleans()),
        gru_layers=draw(st.integers(1, 2)), edge=draw(st.booleans()),
        pre_activation=draw(st.sampled_from([96, 3000, 1e6])),
    )  # fmt: skip
    return Case(books, stages, network)

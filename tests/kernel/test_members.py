"""Members of clusters read by the compiled library: the symbols of the definition (SPEC §10.5), and as many."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fuzz.testing.networks import random_books, random_network
from scarfmt.codecs.neural_indices import IndexCoder, index_coder, read_symbols
from scarfmt.coding.engine import Engine
from scarfmt.kernel import index_layer
from scarfmt.kernel.symbols import KernelSymbolReader
from scarfmt.neural.network import Inputs
from tests.kernel.samples import SEEDS, both, needs_kernel, random_stream, same

pytestmark = needs_kernel


def coder_of(rng: np.random.Generator, codewords: int, two_level: bool, edge: bool) -> IndexCoder:
    """The coder of a random network and of books with these numbers of codewords."""
    books = random_books(rng, codewords, int(rng.integers(1, 30)), int(rng.integers(1, 8)))
    inputs = Inputs(classes=1, own=False, attributes=1, depths=1, latents=0, latent_shift=0, grid=0)
    network = random_network(
        rng, books, inputs, stages=2, hidden=int(rng.integers(1, 12)), two_level=two_level, edge=edge,
        activation_bits=int(rng.integers(8, 13)),
    )  # fmt: skip
    return index_coder(network, books)


@settings(deadline=None, max_examples=80)
@given(SEEDS, st.one_of(st.integers(1, 40), st.just(4096)), st.booleans(), st.booleans(), st.integers(1, 2))
@example(0, 4096, True, True, 1)
@example(1, 4096, False, False, 1)
def test_codewords_on_any_words(seed: int, codewords: int, two_level: bool, edge: bool, stage: int) -> None:
    """Flat heads, clusters of any size with clusters of one among them, accumulators at their limit, no anchor."""
    rng = np.random.default_rng(seed)
    coder = coder_of(rng, codewords, two_level, edge)
    count = int(rng.choice([0, 1, 15, 16, 100]))
    data = random_stream(rng, int(rng.choice([0, 1, 30, 300])))
    mixed = rng.integers(0, coder.network.amax + 1, (count, coder.network.mixer.outputs)).astype(np.float32)

    def act(engine: Engine) -> Any:
        reader = engine.symbol_reader(data, {})
        read = index_layer.read_symbols if isinstance(reader, KernelSymbolReader) else read_symbols
        symbols = read(reader, coder, stage, mixed.copy(), count)
        return symbols, reader.modelled, reader.read_uniform(4096, 6)

    compiled, plain = both(act)
    assert same(compiled, plain)
    assert compiled[0].min(initial=0) >= 0
    assert compiled[0].max(initial=0) < len((coder.books.coarse, coder.books.residual)[stage - 1])

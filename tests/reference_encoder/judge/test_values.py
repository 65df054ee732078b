"""Values that pictures of results are drawn from: what the formulas of the format give, in loops."""

from __future__ import annotations

import numpy as np

from reference_encoder.judge.values import applied, codeword_sums, rounded
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.scene.codebooks import Codebooks


def test_rounded_to_the_widths_of_the_class() -> None:
    """Each component by its own; a class that receives nothing has 0."""
    draw = np.random.default_rng(1)
    true, classes, here = draw.normal(size=(50, 2)), draw.integers(0, 3, 50), np.arange(0, 50, 2)
    widths = np.array([[0.1, 0.3], [0.0, 0.0], [0.02, 0.5]])
    found = rounded(true, here, classes, widths)
    for k, row in enumerate(here):
        width = widths[classes[row]]
        wanted = np.rint(true[row] / width) * width if width.any() else np.zeros(2)
        np.testing.assert_allclose(found[k], wanted, rtol=1e-6)


def test_sums_of_codewords_are_those_of_a_decoder() -> None:
    """A sum has the codewords of the stages that each anchor has received."""
    draw = np.random.default_rng(2)
    books = Codebooks(draw.integers(-900, 900, (8, 5)), draw.integers(-90, 90, (4, 5)))
    indices, stages = draw.integers(0, 4, (60, 3)).astype(np.int16), draw.integers(0, 4, 60)
    assert np.array_equal(codeword_sums(books, indices, stages), books.latents(indices, stages))


def test_a_decoder_gives_the_same_whatever_it_takes_at_a_time() -> None:
    """SPEC R-9.5: rounded after sums in binary64."""
    draw = np.random.default_rng(3)
    decoder = QuantisedMlp((Linear.quantised(draw.normal(size=(6, 4)), draw.normal(size=6)),))
    latents = draw.normal(size=(9000, 4)).astype(np.float32)
    out = np.empty((9000, 6), np.float32)
    applied(decoder, latents, out)
    assert np.array_equal(out, decoder.apply(latents, np.float32))

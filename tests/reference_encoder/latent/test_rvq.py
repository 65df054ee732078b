"""Entropy-constrained residual vector quantisation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reference_encoder.latent.rvq import RvqOptions, RvqResult, Vectors, assign, quantise
from scarfmt.blocks.codebooks import pack_codebooks, unpack_codebooks
from scarfmt.scene.codebooks import Codebooks

OPTIONS = RvqOptions(codewords=32, stages=3, lambda_=0.0, epochs=6, seed=1)


def _latents(count: int = 2000, width: int = 6, seed: int = 0) -> np.ndarray:
    draw = np.random.default_rng(seed)
    centres = draw.normal(size=(40, width)) * 60
    return (centres[draw.integers(0, 40, count)] + draw.normal(size=(count, width)) * 8).astype(np.float32)


def _quantise(latents: np.ndarray, options: RvqOptions, **more: object) -> RvqResult:
    n = len(latents)
    return quantise(Vectors(latents, np.ones(n, np.float32), np.arange(n) % 2), options, **more)  # type: ignore[arg-type]


def test_codewords_are_integers_a_codebooks_block_can_hold() -> None:
    wild = _latents()
    wild[0] = 1e7
    result = _quantise(wild, OPTIONS)
    books = unpack_codebooks(pack_codebooks({0: result.coarse, 1: result.residual}))
    np.testing.assert_array_equal(books[0], result.coarse)
    np.testing.assert_array_equal(books[1], result.residual)


def test_reported_distortion_is_that_of_the_decoded_latents() -> None:
    latents = _latents()
    result = _quantise(latents, OPTIONS)
    for stages in range(4):
        z = Codebooks(result.coarse, result.residual).latents(result.indices, np.full(len(latents), stages))
        np.testing.assert_allclose(((latents - z) ** 2).sum(axis=1), result.distortion[stages], rtol=1e-4, atol=1e-3)


def test_every_stage_lowers_the_distortion() -> None:
    total = _quantise(_latents(), OPTIONS).distortion.sum(axis=1)
    assert (np.diff(total) < 0).all()
    assert total[3] < 0.05 * total[0]


def test_a_higher_price_of_bits_buys_fewer_bits() -> None:
    bits = [_quantise(_latents(), replace(OPTIONS, lambda_=price)).bits.sum() for price in (0.0, 30.0, 1000.0)]
    assert bits[0] > bits[1] > bits[2]


def test_codes_are_numbered_by_falling_use_and_all_are_used() -> None:
    result = _quantise(_latents(), OPTIONS)
    for indices, book in ((result.indices[:, :1], result.coarse), (result.indices[:, 1:], result.residual)):
        used = np.bincount(indices.ravel(), minlength=len(book))
        assert len(used) == len(book)
        assert (used > 0).all()
        assert (np.diff(used) <= 0).all()


def test_same_seed_same_result() -> None:
    one, two = _quantise(_latents(), OPTIONS), _quantise(_latents(), OPTIONS)
    np.testing.assert_array_equal(one.indices, two.indices)
    np.testing.assert_array_equal(one.coarse, two.coarse)


def test_stale_codes_are_revived_where_the_error_is() -> None:
    """All starting codewords coincide: without replacement a single code would ever be used."""
    stuck = np.zeros((32, 6), np.float32)
    result = _quantise(_latents(), replace(OPTIONS, stages=1, epochs=8), start=(stuck, stuck))
    assert len(result.coarse) > 16


def test_given_codewords_are_kept_without_epochs() -> None:
    latents = _latents()
    book = np.concatenate([np.zeros((1, 6)), np.rint(latents[:7])]).astype(np.float32)
    result = _quantise(latents, replace(OPTIONS, stages=1, epochs=0), start=(book, book))
    kept = {tuple(word) for word in result.coarse.tolist()}
    assert kept <= {tuple(word) for word in book.astype(int).tolist()}


def test_assign_weighs_error_against_bits() -> None:
    one, book = np.ones(1, np.float32), np.array([[0.0], [1.0]], np.float32)
    vector = Vectors(np.array([[0.9]], np.float32), one, np.zeros(1, np.int64))
    bits = np.array([[1.0, 5.0]], np.float32)
    cheap, exact = (int(assign(vector, book, bits, price)[0]) for price in (1.0, 0.01))
    assert (cheap, exact) == (0, 1)


@pytest.mark.parametrize("latents", [np.ones((1, 3), np.float32), np.full((5, 3), 7.0, np.float32)])
def test_tiny_inputs(latents: np.ndarray) -> None:
    result = _quantise(latents, OPTIONS)
    assert result.indices.shape == (len(latents), 3)
    assert np.isfinite(result.distortion).all()


def test_zero_weights_are_finite() -> None:
    latents = _latents(50)
    result = quantise(Vectors(latents, np.zeros(50, np.float32), np.zeros(50, np.int64)), replace(OPTIONS, lambda_=1.0))
    assert (result.distortion == 0).all()
    assert np.isfinite(result.bits).all()


def test_no_stages_is_empty_codebooks() -> None:
    result = _quantise(_latents(10), replace(OPTIONS, stages=0))
    assert result.indices.shape == (10, 0)
    assert result.coarse.shape == (0, 6)
    assert result.distortion.shape == (1, 10)

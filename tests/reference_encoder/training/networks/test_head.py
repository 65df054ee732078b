"""Bits of symbols among a range, compiled: those of torch's softmax, with its gradients."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from reference_encoder.training.networks.head import powers, range_bits


def _case(seed: int, rows: int, dims: int, symbols: int) -> tuple[torch.Tensor, ...]:
    draw = np.random.default_rng(seed)
    outputs = torch.from_numpy(draw.normal(0, 1, (rows, dims)).astype(np.float32)).requires_grad_()
    biases = torch.from_numpy(draw.normal(0, 1, symbols).astype(np.float32)).requires_grad_()
    vectors = torch.from_numpy(draw.normal(size=(dims, symbols)).astype(np.float32))
    first = draw.integers(0, symbols, rows)
    last = draw.integers(first + 1, symbols + 1)
    ranges = torch.from_numpy(np.stack([first, last], axis=1))
    return outputs, biases, vectors, ranges, torch.from_numpy(draw.integers(first, last))


def _by_torch(
    outputs: torch.Tensor, biases: torch.Tensor, vectors: torch.Tensor, ranges: torch.Tensor, symbols: torch.Tensor
) -> torch.Tensor:
    place = torch.arange(len(biases))
    there = (place >= ranges[:, :1]) & (place < ranges[:, 1:])
    logits = torch.where(there, (outputs @ vectors + biases) * np.log(2), -1e9)
    share = torch.softmax(logits, 1).gather(1, symbols[:, None])[:, 0]
    return -torch.log2(share * (1 - (ranges[:, 1] - ranges[:, 0]) / 2**24) + 2**-24)


@given(st.integers(0, 10**6), st.integers(0, 6), st.integers(1, 9), st.integers(1, 40))
def test_bits_and_gradients_are_those_of_a_softmax(seed: int, rows: int, dims: int, symbols: int) -> None:
    """For any ranges, weights of the rows included; symbols that are next to impossible cost at most 24 bits."""
    found, expected = _case(seed, rows, dims, symbols), _case(seed, rows, dims, symbols)
    weights = torch.linspace(0.5, 2, rows)
    bits = range_bits(*found), _by_torch(*expected)
    assert torch.allclose(bits[0], bits[1], rtol=1e-3, atol=1e-3)
    for each in bits:
        (each * weights).sum().backward()  # type: ignore[no-untyped-call]
    for one, two in zip(found[:2], expected[:2], strict=True):
        assert two.grad is not None
        assert torch.allclose(one.grad, two.grad, rtol=2e-3, atol=2e-3)


def test_powers_of_two() -> None:
    """To 1e-4 where it matters, and never above 1."""
    x = np.linspace(-31, 0, 1001, dtype=np.float32)
    out = np.empty_like(x)
    powers(x, out)
    assert np.allclose(out, 2.0**x, rtol=1e-3)
    assert np.allclose(out[x > -12], 2.0 ** x[x > -12], rtol=5e-5)
    assert out.max() <= 1.0

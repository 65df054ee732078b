"""Bits of codewords, with their gradients."""

from __future__ import annotations

import math

import numpy as np
import torch

from reference_encoder.training.networks.head import HeadModel
from reference_encoder.training.networks.layers import NetworkShape


def _head() -> HeadModel:
    words = np.random.default_rng(0).integers(-60, 60, (40, 5))
    head = HeadModel(NetworkShape(hidden=4, codeword_dims=4), words, torch.Generator().manual_seed(1))
    head.start_from(np.arange(40))
    return head


def test_bits_are_those_of_a_softmax_in_powers_of_two() -> None:
    """Of logits as they are before they are rounded, in 32nds of a bit."""
    head, y = _head(), torch.arange(24, dtype=torch.float32).reshape(3, 8)
    logits = (head.project(y, -255, 255) @ head.words + head.biases() * head.scale).double()
    expected = torch.log2((2**logits).sum(1)) - logits[range(3), [0, 7, 39]]
    assert torch.allclose(head.bits(y, torch.tensor([0, 7, 39])).double(), expected, atol=1e-3)


def test_codewords_that_are_next_to_impossible_cost_24_bits_and_teach() -> None:
    head, y = _head(), torch.zeros(1, 8)
    head.beta.data[3], head.beta.data[5] = -19, 19
    bits = head.bits(y, torch.tensor([3]))
    assert 23 < float(bits.detach()) <= 24
    bits.sum().backward()  # type: ignore[no-untyped-call]
    assert head.beta.grad is not None
    assert head.beta.grad[3] < 0 < head.beta.grad[5]


def test_biases_begin_with_the_logarithms_of_uses() -> None:
    beta = _head().beta.detach()
    assert float(beta[39]) == 0
    assert math.isclose(float(beta[0]), math.log2(0.3 / 39.3), rel_tol=1e-5)

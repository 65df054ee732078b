"""The index network in torch, trained as the integers it will be (SPEC §10.5; paper §3.4, spatial-query attention).

Every layer keeps real parameters on fixed power-of-two scales; forward they are rounded to the integers of the
file and everything is computed in exact integers (float32 tensors), backward roundings count as the identity.
With `exact` off the same network runs in floating point without roundings and clamps: the float model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from reference_encoder.networks.head import HeadModel
from reference_encoder.networks.integers import (
    SIGMOID_ONE,
    UNIT,
    exp2_weights,
    limited,
    round_shift,
    rounded,
    settled,
    sigmoid12,
    tanh12,
)
from reference_encoder.networks.layers import Dense, Scale, geometric_bits, whole
from reference_encoder.networks.shape import NetworkShape
from reference_encoder.tuning import BIAS_BITS
from scarfmt.arrays import I64
from scarfmt.scene.codebooks import Codebooks

_GATE_LIMIT = 2047.0
_GRU_BOUND = 1 << 23
_GRID_SPREAD = 64.0
# A column that is nearly constant must not get weights that are huge.
_LEAST_SPREAD = 6.0


@dataclass(frozen=True)
class InputStatistics:
    """(width,) mean and spread of the inputs, to start from."""

    mean: NDArray[np.float64]
    spread: NDArray[np.float64]

    @classmethod
    def of(cls, inputs: NDArray[np.integer[Any]], top: int) -> InputStatistics:
        """The statistics of (n, width) inputs clamped to -top..top."""
        clamped = np.clip(inputs, -top, top).astype(np.float64)
        return cls(clamped.mean(axis=0), np.maximum(clamped.std(axis=0), _LEAST_SPREAD))

    def extended(self, features: int) -> InputStatistics:
        """With those of `features` more inputs from a hash grid."""
        more = np.zeros(features), np.full(features, _GRID_SPREAD)
        return InputStatistics(np.append(self.mean, more[0]), np.append(self.spread, more[1]))


@dataclass(frozen=True)
class Batch:
    """Rows to code: (n, width) float32 inputs, (n,) stages before and after, (n, M) int64 codes."""

    inputs: torch.Tensor
    before: torch.Tensor
    after: torch.Tensor
    codes: torch.Tensor


class GruModel(nn.Module):
    """One GRU layer; its integers are px = W_b e_k + S_m of layer 1, px = W g + b of others, ph = U g + c."""

    def __init__(
        self, shape: NetworkShape, inputs: Sequence[Scale], stages: int, rows: int, generator: torch.Generator
    ) -> None:
        """`inputs`: what each input matrix sees; `rows`: of biases, one a token or one for all."""
        super().__init__()
        self.shape, hidden = shape, shape.hidden
        state = Scale.state(shape.activation_bits, hidden)
        self.inputs = nn.ModuleList(
            Dense(scale, 3 * hidden, UNIT, shape, generator, bias=False, bound=_GRU_BOUND) for scale in inputs
        )
        self.recurrent = Dense(state, 3 * hidden, UNIT, shape, generator, bound=_GRU_BOUND)
        # Sums px + ph need one shift for all.
        shift = min(dense.shift for dense in [*self.dense_inputs, self.recurrent])
        for dense in [*self.dense_inputs, self.recurrent]:
            dense.rescale(shift)
        self.shift = shift
        self.biases = nn.Parameter(torch.zeros(rows, 3 * hidden))
        self.start = nn.Parameter(torch.zeros(hidden))
        # With one token only, the state it meets is a constant: the recurrent part has nothing to say.
        self.single = stages <= 2
        if self.single or not shape.recurrent:
            self.recurrent.freeze()
        if not shape.recurrent:
            for dense in self.dense_inputs:
                dense.freeze()

    @property
    def dense_inputs(self) -> list[Dense]:
        """The input matrices: one a book for the first layer, else one."""
        return [module for module in self.inputs if isinstance(module, Dense)]

    def bias_integers(self, exact: bool) -> torch.Tensor:
        """(rows, 3H) biases of px."""
        return rounded(self.biases * (UNIT * 2.0**self.shift), exact)

    def start_integers(self, exact: bool) -> torch.Tensor:
        """(H,) start state."""
        top = self.shape.top
        return limited(rounded(self.start * (top + 1), exact), -top, top, exact)

    def step(self, px: torch.Tensor, state: torch.Tensor, exact: bool) -> torch.Tensor:
        """(n, H) next state, from (n, 3H) px and (n, H) state."""
        ph = self.recurrent.sums(state, exact)
        (pz, pr, pn), (hz, hr, hn) = px.chunk(3, 1), ph.chunk(3, 1)
        z = sigmoid12(round_shift(pz + hz, self.shift, exact), exact)
        r = sigmoid12(round_shift(pr + hr, self.shift, exact), exact)
        seen = settled(hn, self.shift, -_GATE_LIMIT, _GATE_LIMIT, exact)
        new = tanh12(round_shift(pn, self.shift, exact) + round_shift(r * seen, 12, exact), exact)
        new = round_shift(new, 12 - self.shape.activation_bits, exact).clamp(-self.shape.top, self.shape.top)
        return round_shift(z * state + (SIGMOID_ONE - z) * new, 12, exact)


class AttentionModel(nn.Module):
    """Spatial-query attention over the states of the top GRU layer."""

    def __init__(self, shape: NetworkShape, generator: torch.Generator) -> None:
        super().__init__()
        state, value = Scale.state(shape.activation_bits, shape.hidden), Scale.hidden(shape, shape.hidden)
        self.top = shape.top
        self.query = Dense(value, shape.hidden, UNIT, shape, generator)
        self.key = Dense(state, shape.hidden, UNIT, shape, generator)
        self.value = Dense(state, shape.hidden, value.unit, shape, generator)
        # Queries and keys of one unit (32) in every dimension make a score of 32 * sqrt(H): sqrt(H) bits.
        self.shift = 5 + round(np.log2(shape.hidden) / 2)

    def forward(self, h: torch.Tensor, states: list[torch.Tensor], exact: bool) -> torch.Tensor:
        """(n, H) context, from (n, H) embedding and states."""
        query = self.query(h, exact, -127, 127)
        keys = [self.key(state, exact, -127, 127) for state in states]
        scores = torch.stack([round_shift((query * key).sum(1), self.shift, exact) for key in keys], 1)
        shares = _shares(scores, exact)
        values = torch.stack([self.value(state, exact, -self.top, self.top) for state in states], 1)
        return settled((shares[:, :, None] * values).sum(1), 8, -self.top, self.top, exact)


def _shares(scores: torch.Tensor, exact: bool) -> torch.Tensor:
    """(n, t) shares, 256ths, of (n, t) scores in 32nds of a bit."""
    smooth = 256 * torch.softmax(scores * (np.log(2) / UNIT), 1)
    if not exact:
        return smooth
    weights = exp2_weights(scores.detach().max(1, keepdim=True).values - scores.detach())
    whole_shares = (256 * weights) // weights.sum(1, keepdim=True)
    return smooth + (whole_shares.float() - smooth.detach())


class IndexModel(nn.Module):
    """The network: probabilities of every index given inputs and earlier indices."""

    def __init__(
        self,
        shape: NetworkShape,
        books: Codebooks,
        clusters: Sequence[Sequence[int]],
        stages: int,
        statistics: InputStatistics,
        seed: int = 0,
    ) -> None:
        """`books` in the order of their `clusters` (one empty: coded flat); `stages`: M."""
        super().__init__()
        generator = torch.Generator().manual_seed(seed)
        self.shape, self.stages = shape, stages
        words = [book for book in (books.coarse, books.residual) if len(book)][: min(stages, 2)]
        self.codeword_shift, seen = _codewords(words, shape)
        self.codeword_dims = seen[0].shape[1] - shape.magnitude
        value = Scale.hidden(shape, shape.hidden)
        self.first = Dense(Scale.inputs(statistics.mean, statistics.spread), shape.middle, value.unit, shape, generator)
        self.second = Dense(Scale.hidden(shape, shape.middle), shape.hidden, value.unit, shape, generator)
        state = Scale.state(shape.activation_bits, shape.hidden)
        tokens = [Scale.codewords(word) for word in seen]
        layers = [GruModel(shape, tokens, stages, max(stages - 1, 0), generator)]
        layers += [GruModel(shape, [state], stages, 1, generator) for _ in range(1, shape.gru_layers)]
        self.gru = nn.ModuleList(layers)
        self.attention = AttentionModel(shape, generator) if shape.attention else None
        context = value if shape.attention else state
        self.mixer = Dense(Scale.joined(value, context), shape.mixer, value.unit, shape, generator)
        self.heads = nn.ModuleList(
            HeadModel(shape, word, sizes, generator) for word, sizes in zip(seen, clusters, strict=False)
        )
        for number, word in enumerate(seen):
            self.register_buffer(f"codewords{number}", torch.from_numpy(word.astype(np.float32)))

    def codewords(self, book: int) -> torch.Tensor:
        """(n, R) integers the network sees of a book."""
        found: torch.Tensor = getattr(self, f"codewords{book}")
        return found

    @property
    def layers(self) -> list[GruModel]:
        """GRU layers."""
        return [module for module in self.gru if isinstance(module, GruModel)]

    def head(self, book: int) -> HeadModel:
        """Head of the coarse or the residual book."""
        module = self.heads[book]
        assert isinstance(module, HeadModel)
        return module

    def embed(self, inputs: torch.Tensor, exact: bool) -> torch.Tensor:
        """(n, H) spatial embedding of (n, width) inputs."""
        top = self.shape.top
        middle = self.first(inputs.clamp(-top, top), exact, 0, top)
        out: torch.Tensor = self.second(middle, exact, -top, top)
        return out

    def histories(self, codes: torch.Tensor, exact: bool, upto: int) -> list[torch.Tensor]:
        """Top states G_0..G_upto, (n, H) each, after 0..upto of the (n, M) `codes`."""
        states = [layer.start_integers(exact).expand(len(codes), -1) for layer in self.layers]
        out = [states[-1]]
        for stage in range(1, upto + 1):
            below: torch.Tensor | None = None
            for number, layer in enumerate(self.layers):
                book, row = (min(stage - 1, 1), stage - 1) if below is None else (0, 0)
                token = self.codewords(book)[codes[:, stage - 1]] if below is None else below
                px = layer.dense_inputs[book].sums(token, exact) + layer.bias_integers(exact)[row]
                states[number] = below = layer.step(px, states[number], exact)
            out.append(states[-1])
        return out

    def context(self, h: torch.Tensor, states: list[torch.Tensor], exact: bool) -> torch.Tensor:
        """(n, Y) from the embedding and the states so far."""
        seen = states[-1] if self.attention is None else self.attention(h, states, exact)
        out: torch.Tensor = self.mixer(torch.cat([h, seen], 1), exact, 0, self.shape.top)
        return out

    def bits(self, batch: Batch, exact: bool = True, strict: bool = False) -> list[torch.Tensor]:
        """Per stage, (rows that code it,) bits of each index.

        Args:
            strict: bits of the integer frequencies themselves, without gradients, float64.
        """
        h = self.embed(batch.inputs, exact)
        out = []
        for stage in range(1, self.stages + 1):
            chosen = torch.nonzero((batch.before < stage) & (batch.after >= stage))[:, 0]
            codes = batch.codes[chosen]
            y = self.context(h[chosen], self.histories(codes, exact, stage - 1), exact)
            head = self.head(min(stage - 1, 1))
            out.append(head.exact_bits(y, codes[:, stage - 1]) if strict else head.bits(y, codes[:, stage - 1], exact))
        return out

    def weight_bits(self) -> torch.Tensor:
        """About how many bits the network takes in the file."""
        parts = [m.scaled() for m in self.modules() if isinstance(m, Dense) and not m.frozen]
        parts += [steps for head in self.heads if isinstance(head, HeadModel) for steps in head.bias_steps()]
        counted = sum(m.bias.numel() for m in self.modules() if isinstance(m, Dense) and m.biased and not m.frozen)
        counted += sum(layer.biases.numel() + layer.start.numel() for layer in self.layers)
        return geometric_bits(parts) + BIAS_BITS * counted


def _codewords(books: Sequence[I64], shape: NetworkShape) -> tuple[int, list[I64]]:
    """The shift that fits codewords into activations, and the first R dimensions of each book after it."""
    dims = min(shape.codeword_dims, books[0].shape[1])
    largest = max(int(np.abs(book[:, :dims]).max(initial=0)) for book in books)
    shift = max(0, largest.bit_length() - (shape.activation_bits - 1))
    parts = [np.clip(whole(book[:, :dims] / 2.0**shift), -shape.top, shape.top) for book in books]
    if shape.magnitude:
        parts = [np.concatenate([part, np.minimum(magnitudes(part), shape.top)], axis=1) for part in parts]
    return shift, [part.astype(np.int64) for part in parts]


def magnitudes(words: NDArray[np.floating[Any] | np.integer[Any]]) -> NDArray[np.float64]:
    """(n, 1) magnitudes of integer (n, R) codewords: 8 times the bit length of the squared length."""
    squares: NDArray[np.float64] = np.square(words.astype(np.float64)).sum(axis=1, keepdims=True)
    return np.asarray(8.0 * np.frexp(squares)[1])

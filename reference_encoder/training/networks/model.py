"""The index network in torch, trained as the integers it will be (SPEC §10.5; paper §3.4, spatial-query attention).

Every layer keeps real parameters on fixed power-of-two scales; forward they are rounded to the integers of the file and
everything is computed in exact integers (float32 tensors), backward roundings count as the identity.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from reference_encoder.training.networks.head import HeadModel
from reference_encoder.training.networks.layers import (
    ACTIVATION_BITS,
    HIDDEN_UNIT,
    SIGMOID_ONE,
    TOP,
    UNIT,
    Dense,
    NetworkShape,
    Scale,
    exp2_weights,
    geometric_bits,
    hidden_scale,
    round_half_up,
    round_shift,
    shift_and_clamp,
    sigmoid12,
    state_scale,
    tanh12,
)
from reference_encoder.tuning import BIAS_BITS
from scarfmt.arrays import I32, I64
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.network import Attention, GruLayer, Head, IndexNetwork, Inputs, as_activations
from scarfmt.scene.model import Codebooks

_GATE_LIMIT = 2047.0
_GRU_BOUND = 1 << 23
_GRID_SPREAD = 64.0
# A column that is nearly constant must not get weights that are huge.
_LEAST_SPREAD = 6.0


def input_scale(inputs: NDArray[np.integer[Any]], grid_features: int) -> Scale:
    """Spread and mean, (width + grid_features,) each, of (n, width) inputs and, to start from, of a grid's features."""
    clamped = np.clip(inputs, -TOP, TOP).astype(np.float64)
    spread = np.maximum(clamped.std(axis=0), _LEAST_SPREAD)
    more = np.full(grid_features, _GRID_SPREAD), np.zeros(grid_features)
    return np.append(spread, more[0]), np.append(clamped.mean(axis=0), more[1])


Batch = tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]
"""Rows to code: (n, width) float32 inputs, (n,) stages before and after, (n, M) int64 codes."""


class GruModel(nn.Module):
    """One GRU layer; its integers are px = W_b e_k + S_m of layer 1, px = W g + b of others, ph = U g + c."""

    def __init__(
        self, shape: NetworkShape, inputs: Sequence[Scale], stages: int, rows: int, generator: torch.Generator
    ) -> None:
        """`inputs`: what each input matrix sees; `rows`: of biases, one a token or one for all."""
        super().__init__()
        hidden, bits = shape.hidden, shape.weight_bits
        # One input matrix a book for the first layer, else one.
        self.dense_inputs = [
            Dense(scale, 3 * hidden, UNIT, bits, generator, bias=False, bound=_GRU_BOUND) for scale in inputs
        ]
        self.inputs = nn.ModuleList(self.dense_inputs)
        self.recurrent = Dense(state_scale(hidden), 3 * hidden, UNIT, bits, generator, bound=_GRU_BOUND)
        # Sums px + ph need one shift for all.
        shift = min(dense.shift for dense in [*self.dense_inputs, self.recurrent])
        for dense in [*self.dense_inputs, self.recurrent]:
            dense.rescale(shift)
        self.shift = shift
        self.biases = nn.Parameter(torch.zeros(rows, 3 * hidden))
        self.start = nn.Parameter(torch.zeros(hidden))
        # With one token only, the state it meets is a constant: the recurrent part has nothing to say.
        if stages <= 2:
            self.recurrent.freeze()

    def bias_integers(self) -> torch.Tensor:
        """(rows, 3H) biases of px."""
        return round_half_up(self.biases * (UNIT * 2.0**self.shift))

    def start_integers(self) -> torch.Tensor:
        """(H,) start state."""
        return round_half_up(self.start * (TOP + 1)).clamp(-TOP, TOP)

    def step(self, px: torch.Tensor, state: torch.Tensor) -> torch.Tensor:
        """(n, H) next state, from (n, 3H) px and (n, H) state."""
        ph = self.recurrent.sums(state)
        (pz, pr, pn), (hz, hr, hn) = px.chunk(3, 1), ph.chunk(3, 1)
        z = sigmoid12(round_shift(pz + hz, self.shift))
        r = sigmoid12(round_shift(pr + hr, self.shift))
        seen = shift_and_clamp(hn, self.shift, -_GATE_LIMIT, _GATE_LIMIT)
        new = tanh12(round_shift(pn, self.shift) + round_shift(r * seen, 12))
        new = round_shift(new, 12 - ACTIVATION_BITS).clamp(-TOP, TOP)
        return round_shift(z * state + (SIGMOID_ONE - z) * new, 12)


class AttentionModel(nn.Module):
    """Spatial-query attention over the states of the top GRU layer."""

    def __init__(self, shape: NetworkShape, generator: torch.Generator) -> None:
        super().__init__()
        hidden, bits, state = shape.hidden, shape.weight_bits, state_scale(shape.hidden)
        self.query = Dense(hidden_scale(hidden), hidden, UNIT, bits, generator)
        self.key = Dense(state, hidden, UNIT, bits, generator)
        self.value = Dense(state, hidden, HIDDEN_UNIT, bits, generator)
        # Queries and keys of one unit (32) in every dimension make a score of 32 * sqrt(H): sqrt(H) bits.
        self.shift = 5 + round(np.log2(shape.hidden) / 2)

    def forward(self, h: torch.Tensor, states: list[torch.Tensor]) -> torch.Tensor:
        """(n, H) context, from (n, H) embedding and states."""
        query = self.query(h, -127, 127)
        keys = [self.key(state, -127, 127) for state in states]
        scores = torch.stack([round_shift((query * key).sum(1), self.shift) for key in keys], 1)
        shares = _shares(scores)
        values = torch.stack([self.value(state, -TOP, TOP) for state in states], 1)
        return shift_and_clamp((shares[:, :, None] * values).sum(1), 8, -TOP, TOP)


def _shares(scores: torch.Tensor) -> torch.Tensor:
    """(n, t) shares, 256ths, of (n, t) scores in 32nds of a bit."""
    smooth = 256 * torch.softmax(scores * (np.log(2) / UNIT), 1)
    weights = exp2_weights(scores.detach().max(1, keepdim=True).values - scores.detach())
    whole_shares = (256 * weights) // weights.sum(1, keepdim=True)
    return smooth + (whole_shares.float() - smooth.detach())


class IndexModel(nn.Module):
    """The network: probabilities of every index given inputs and earlier indices."""

    def __init__(
        self,
        shape: NetworkShape,
        books: Codebooks,
        stages: int,
        inputs: Scale,
        seed: int = 0,
    ) -> None:
        """`stages`: M; `inputs`: of :func:`input_scale`."""
        super().__init__()
        generator = torch.Generator().manual_seed(seed)
        self.stages = stages
        words = [book for book in (books.coarse, books.residual) if len(book)][: min(stages, 2)]
        self.codeword_shift, seen = _codewords(words, shape.codeword_dims)
        self.codeword_dims = seen[0].shape[1] - 1
        hidden, wide, bits = shape.hidden, shape.wide, shape.weight_bits
        value, state = hidden_scale(hidden), state_scale(hidden)
        self.first = Dense(inputs, wide, HIDDEN_UNIT, bits, generator)
        self.second = Dense(hidden_scale(wide), hidden, HIDDEN_UNIT, bits, generator)
        tokens = [(np.maximum(word.std(axis=0), 2.0), np.zeros(word.shape[1])) for word in seen]
        self.layers = [GruModel(shape, tokens, stages, max(stages - 1, 0), generator)]
        self.layers += [GruModel(shape, [state], stages, 1, generator) for _ in range(1, shape.gru_layers)]
        self.gru = nn.ModuleList(self.layers)
        self.attention = AttentionModel(shape, generator) if shape.attention else None
        context = value if shape.attention else state
        joined = np.append(value[0], context[0]), np.append(value[1], context[1])
        self.mixer = Dense(joined, wide, HIDDEN_UNIT, bits, generator)
        # The head of the coarse book, and that of the residual one.
        self.head = [HeadModel(shape, word, generator) for word in seen]
        self.heads = nn.ModuleList(self.head)
        # Integers that the network sees of each book.
        self.codewords = [torch.from_numpy(word.astype(np.float32)) for word in seen]

    def embed(self, inputs: torch.Tensor) -> torch.Tensor:
        """(n, H) spatial embedding of (n, width) inputs."""
        middle = self.first(inputs.clamp(-TOP, TOP), 0, TOP)
        out: torch.Tensor = self.second(middle, -TOP, TOP)
        return out

    def histories(self, codes: torch.Tensor, upto: int) -> list[torch.Tensor]:
        """Top states G_0..G_upto, (n, H) each, after 0..upto of the (n, M) `codes`."""
        states = [layer.start_integers().expand(len(codes), -1) for layer in self.layers]
        out = [states[-1]]
        for stage in range(1, upto + 1):
            below: torch.Tensor | None = None
            for number, layer in enumerate(self.layers):
                book, row = (min(stage - 1, 1), stage - 1) if below is None else (0, 0)
                token = self.codewords[book][codes[:, stage - 1]] if below is None else below
                px = layer.dense_inputs[book].sums(token) + layer.bias_integers()[row]
                states[number] = below = layer.step(px, states[number])
            out.append(states[-1])
        return out

    def context(self, h: torch.Tensor, states: list[torch.Tensor]) -> torch.Tensor:
        """(n, Y) from the embedding and the states so far."""
        seen = states[-1] if self.attention is None else self.attention(h, states)
        out: torch.Tensor = self.mixer(torch.cat([h, seen], 1), 0, TOP)
        return out

    def bits(self, batch: Batch) -> list[torch.Tensor]:
        """Per stage, (rows that code it,) bits of each index."""
        inputs, before, after, every = batch
        h, out = self.embed(inputs), []
        for stage in range(1, self.stages + 1):
            chosen = torch.nonzero((before < stage) & (after >= stage))[:, 0]
            codes = every[chosen]
            y = self.context(h[chosen], self.histories(codes, stage - 1))
            out.append(self.head[min(stage - 1, 1)].bits(y, codes[:, stage - 1]))
        return out

    def weight_bits(self) -> torch.Tensor:
        """About how many bits the network takes in the file."""
        parts = [m.scale_weights() for m in self.modules() if isinstance(m, Dense) and not m.frozen]
        parts += [head.bias_steps() for head in self.head]
        counted = sum(m.bias.numel() for m in self.modules() if isinstance(m, Dense) and m.biased and not m.frozen)
        counted += sum(layer.biases.numel() + layer.start.numel() for layer in self.layers)
        return geometric_bits(parts) + BIAS_BITS * counted


def _codewords(books: Sequence[I64], most: int) -> tuple[int, list[I64]]:
    """The shift that fits codewords into activations, and the first dimensions, at most so many, of each book after
    it."""
    dims = min(most, books[0].shape[1])
    largest = max(int(np.abs(book[:, :dims]).max(initial=0)) for book in books)
    shift = max(0, largest.bit_length() - (ACTIVATION_BITS - 1))
    return shift, [as_activations(book[:, :dims], shift, TOP) for book in books]


def export_network(model: IndexModel, inputs: Inputs, books: Codebooks) -> IndexNetwork:
    """The network as the file holds it.

    Args:
        inputs: meaning of the columns the model was trained on.
        books: those that the model was made for.

    Raises:
        Malformed: ``bad-network``; the bounds kept in training make it a fault of this program.
    """
    attention = model.attention
    with torch.no_grad():
        network = IndexNetwork(
            ACTIVATION_BITS,
            inputs,
            model.codeword_dims,
            model.codeword_shift,
            (_linear(model.first), _linear(model.second)),
            tuple(_gru(layer) for layer in model.layers),
            _attention(attention) if attention is not None else None,
            _linear(model.mixer),
            tuple(_head(head) for head in model.head),
        )
    network.check(books, model.stages)
    return network


def _matrix(values: torch.Tensor) -> I32:
    return np.asarray(values.numpy(), np.int32)


def _vector(values: torch.Tensor) -> I64:
    return np.asarray(values.numpy(), np.int64)


def _linear(dense: Dense) -> Linear:
    weights, biases = dense.integers()
    return Linear(_matrix(weights), _vector(biases), dense.shift)


def _gru(layer: GruModel) -> GruLayer:
    recurrent, recurrent_biases = layer.recurrent.integers()
    return GruLayer(
        tuple(_matrix(dense.integers()[0]) for dense in layer.dense_inputs),
        _matrix(recurrent),
        _vector(layer.bias_integers()),
        _vector(recurrent_biases),
        _vector(layer.start_integers()),
        layer.shift,
    )


def _attention(part: AttentionModel) -> Attention:
    return Attention(_linear(part.query), _linear(part.key), _linear(part.value), part.shift)


def _head(head: HeadModel) -> Head:
    return Head(_linear(head.project), _vector(head.biases()), head.shift)

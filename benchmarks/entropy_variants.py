"""Context models that the product does not use, for the ablation of docs/ablations.md (paper §5.1).

They keep everything of the index network but the part named: same inputs, same heads, same rounding to integers,
same cost of weights. The format has no place for them, so they are trained and measured in torch and never exported.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import torch

from reference_encoder.networks.dataset import IndexRows
from reference_encoder.networks.layers import Dense, Scale
from reference_encoder.networks.model import IndexModel, InputStatistics
from reference_encoder.networks.shape import NetworkShape
from reference_encoder.networks.train import code_uses
from scarfmt.scene.codebooks import Codebooks


class Variant(IndexModel):
    """The index network with a part of it replaced."""

    def __init__(
        self,
        shape: NetworkShape,
        books: Codebooks,
        clusters: Sequence[Sequence[int]],
        stages: int,
        statistics: InputStatistics,
        seed: int = 0,
    ) -> None:
        super().__init__(shape, books, clusters, stages, statistics, seed)
        self.change(torch.Generator().manual_seed(seed))

    @abstractmethod
    def change(self, generator: torch.Generator) -> None:
        """Replace the part; weights are drawn from `generator`."""


class StageMlp(Variant):
    """The paper's MLP: the spatial embedding and the number of the stage, nothing of earlier indices."""

    def change(self, generator: torch.Generator) -> None:
        """In place of states, the mixer sees which stage it is."""
        shape = self.shape
        self.gru, self.attention = torch.nn.ModuleList(), None
        value = Scale.hidden(shape, shape.hidden)
        seen = Scale.joined(value, Scale.hidden(shape, self.stages))
        self.mixer = Dense(seen, shape.mixer, value.unit, shape, generator)

    def histories(self, codes: torch.Tensor, exact: bool, upto: int) -> list[torch.Tensor]:
        """(n, M) one-hot numbers of the stages 1..upto + 1, in place of states."""
        return [_one_hot(self, len(codes), stage) for stage in range(upto + 1)]


class BranchedMlp(Variant):
    """The paper's branched MLP: one branch sees the spatial embedding, one the earlier codewords.

    Each has its own mixer and its own half of the heads, and their logits are added: the heads are linear in what
    they see, so a head over both halves side by side is the sum of two heads.
    """

    def change(self, generator: torch.Generator) -> None:
        """Two mixers of half the width in place of the recurrent part, one for each branch."""
        shape = self.shape
        self.gru, self.attention = torch.nn.ModuleList(), None
        value, half = Scale.hidden(shape, shape.hidden), shape.mixer // 2
        seen = Scale.hidden(shape, self.stages)
        for stage in range(self.stages - 1, 0, -1):
            seen = Scale.joined(Scale.codewords(self.codewords(min(stage - 1, 1)).numpy()), seen)
        self.mixer = Dense(value, half, value.unit, shape, generator)
        self.earlier = Dense(seen, shape.hidden, value.unit, shape, generator)
        self.branch = Dense(value, shape.mixer - half, value.unit, shape, generator)

    def histories(self, codes: torch.Tensor, exact: bool, upto: int) -> list[torch.Tensor]:
        """Before each of the stages 1..upto + 1, (n, (M - 1) * columns + M): codewords so far, then the stage."""
        words = [self.codewords(min(stage, 1))[codes[:, stage]] for stage in range(self.stages - 1)]
        return [
            torch.cat([*(w * (k < stage) for k, w in enumerate(words)), _one_hot(self, len(codes), stage)], 1)
            for stage in range(upto + 1)
        ]

    def context(self, h: torch.Tensor, states: list[torch.Tensor], exact: bool) -> torch.Tensor:
        """(n, Y): what the spatial branch says beside what the other says."""
        top = self.shape.top
        spatial = self.mixer(h, exact, 0, top)
        earlier = self.branch(self.earlier(states[-1], exact, 0, top), exact, 0, top)
        return torch.cat([spatial, earlier], 1)


class GruOnly(Variant):
    """The paper's vanilla GRU: the state over earlier indices, nothing of where the anchor lies."""

    def change(self, generator: torch.Generator) -> None:
        """The mixer sees the state alone, and the embedding is frozen."""
        shape = self.shape
        # Frozen layers cost no bits: a file without the embedding would not hold them.
        self.first.freeze()
        self.second.freeze()
        unit = Scale.hidden(shape, 1).unit
        self.mixer = Dense(Scale.state(shape.activation_bits, shape.hidden), shape.mixer, unit, shape, generator)

    def context(self, h: torch.Tensor, states: list[torch.Tensor], exact: bool) -> torch.Tensor:
        """(n, Y) from the last state."""
        out: torch.Tensor = self.mixer(states[-1], exact, 0, self.shape.top)
        return out


def build_variant(
    kind: type[IndexModel],
    rows: IndexRows,
    books: Codebooks,
    clusters: Sequence[Sequence[int]],
    shape: NetworkShape,
    seed: int,
) -> IndexModel:
    """An untrained network of `kind`, right on average, to be given to `train` as its start."""
    statistics = InputStatistics.of(rows.inputs, shape.top)
    model = kind(shape, books, clusters, rows.codes.shape[1], statistics, seed)
    for book, uses in enumerate(code_uses(rows, books.sizes)[: len(model.heads)]):
        model.head(book).start_from(uses)
    return model


def _one_hot(model: IndexModel, count: int, stage: int) -> torch.Tensor:
    """(count, M), a unit of hidden values in the column of `stage`, counted from 0."""
    out = torch.zeros(count, model.stages)
    out[:, stage] = Scale.hidden(model.shape, 1).unit
    return out

"""Training of the index network: what it codes plus what it costs, in bits, on a bounded budget.

The file pays for the network, so the loss is the bits of the indices plus those of the weights; trained on all rows
of a scene there is no overfitting that this sum does not show. Same rows, options and seed give the same network.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from reference_encoder.networks.dataset import IndexRows
from reference_encoder.networks.grid import BinaryGrid, Lookup
from reference_encoder.networks.model import Batch, IndexModel, InputStatistics
from reference_encoder.networks.shape import NetworkShape
from reference_encoder.tuning import MEASURED_ROWS, SETTLED_EPOCHS, STEEPEST
from scarfmt.arrays import I64
from scarfmt.scene.codebooks import Codebooks

_CHUNK = 4096


@dataclass(frozen=True)
class TrainOptions:
    """How the network is trained.

    Attributes:
        epochs: passes over the rows.
        batch: rows a step.
        learning_rate: highest, of Adam with a one-cycle schedule.
        weight_rate: weight of the network's own bits; 1 is what they cost a scene as large as the sample, which
            keeps a network from learning a small sample by heart.
        quantised: train the integers; off: the float model, to compare.
        patience: stop when the rest of the epochs would, at the pace of the last, save fewer bytes than this.
        seed: of everything random.
    """

    epochs: int = 12
    batch: int = 1024
    learning_rate: float = 0.02
    weight_rate: float = 1.0
    quantised: bool = True
    patience: float = 24.0
    seed: int = 0


@dataclass(frozen=True)
class Trained:
    """A trained network.

    Attributes:
        model: in torch.
        history: estimated bits of the whole scene's indices plus network after each epoch; an estimate from the
            training rows, so too good where these are a small sample.
        index_bits: estimated bits of the whole scene's indices.
        network_bits: estimated bits of the network.
    """

    model: IndexModel
    history: list[float]
    index_bits: float
    network_bits: float

    @property
    def bits(self) -> float:
        """Estimated bits of indices and network."""
        return self.index_bits + self.network_bits


class Examples:
    """Rows as tensors, and a hash grid whose features are further inputs.

    Args:
        grid: learned along with the network.
        lookup: what it reads for each of the rows.
    """

    def __init__(self, rows: IndexRows, grid: BinaryGrid | None = None, lookup: Lookup | None = None) -> None:
        self._all = Batch(
            torch.from_numpy(rows.inputs),
            torch.from_numpy(rows.before),
            torch.from_numpy(rows.after),
            torch.from_numpy(rows.codes.astype(np.int64)),
        )
        self.rows, self.grid, self._lookup = rows, grid, lookup
        self.sent = max(int((rows.after - rows.before).sum()), 1)
        self.scale = rows.symbols / self.sent

    def __len__(self) -> int:
        return len(self._all.before)

    def batch(self, chosen: torch.Tensor) -> Batch:
        """The rows `chosen`, (m,) int64."""
        every, inputs = self._all, self._all.inputs[chosen].float()
        if self.grid is not None and self._lookup is not None:
            inputs = torch.cat([inputs, self.grid(self._lookup.take(chosen))], 1)
        return Batch(inputs, every.before[chosen], every.after[chosen], every.codes[chosen])


def measure(
    model: IndexModel, examples: Examples, exact: bool = True, strict: bool = False, most: int | None = None
) -> NDArray[np.float64]:
    """(M,) bits of the indices of every stage of the examples, or of about `most` spread over them, scaled up."""
    step = max(1, len(examples) // most) if most else 1
    chosen = torch.arange(0, len(examples), step)
    totals, sent = np.zeros(model.stages), 0
    with torch.no_grad():
        for rows in torch.split(chosen, _CHUNK):
            batch = examples.batch(rows)
            totals += [float(bits.double().sum()) for bits in model.bits(batch, exact, strict)]
            sent += int((batch.after - batch.before).sum())
    return totals * (examples.sent / max(sent, 1))


def code_uses(rows: IndexRows, sizes: Sequence[int]) -> list[I64]:
    """(n,) uses of each codeword of the coarse and the residual book in `rows`."""
    uses = [np.zeros(size, np.int64) for size in sizes]
    for stage in range(1, rows.codes.shape[1] + 1):
        sent = (rows.before < stage) & (rows.after >= stage)
        book = min(stage - 1, 1)
        uses[book] += np.bincount(rows.codes[sent, stage - 1], minlength=sizes[book])
    return uses


def build(
    rows: IndexRows,
    books: Codebooks,
    clusters: Sequence[Sequence[int]],
    shape: NetworkShape,
    seed: int,
    grid_features: int = 0,
) -> IndexModel:
    """An untrained network for `rows`: right on average, knows nothing else."""
    statistics = InputStatistics.of(rows.inputs, shape.top).extended(grid_features)
    model = IndexModel(shape, books, clusters, rows.codes.shape[1], statistics, seed)
    for book, uses in enumerate(code_uses(rows, books.sizes)[: len(model.heads)]):
        model.head(book).start_from(uses)
    return model


class Descent:
    """Steps of training by Adam, of a network and of the hash grid of its examples."""

    def __init__(self, model: IndexModel, examples: Examples, options: TrainOptions) -> None:
        self.model, self.examples, self._options = model, examples, options
        # Fused: the network is small, and a call for every parameter and operation would take as long as its gradients.
        self.optimiser = torch.optim.Adam(_groups(model, examples.grid, options.learning_rate), fused=True)

    def step(self, chosen: torch.Tensor, expected: float) -> float:
        """One step on the rows `chosen`, (m,) int64, of which so many hold `expected` indices on average.

        Returns:
            Bits of the indices of these rows, over `expected`.
        """
        bits = torch.cat(self.model.bits(self.examples.batch(chosen), self._options.quantised)).sum() / expected
        loss = bits + self._options.weight_rate / self.examples.sent * _network_bits(self.model, self.examples.grid)
        self.optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), STEEPEST)
        self.optimiser.step()
        return float(bits.detach())


def train(
    rows: IndexRows,
    books: Codebooks,
    clusters: Sequence[Sequence[int]],
    shape: NetworkShape,
    options: TrainOptions,
    report: Callable[[float], None] = lambda _fraction: None,
    start: IndexModel | None = None,
    grid: BinaryGrid | None = None,
    lookup: Lookup | None = None,
) -> Trained:
    """Train a network on `rows`, codes in the order of the `clusters` of `books`.

    On one thread: sums of gradients, and with them the file, would depend on how many there are.

    Args:
        start: a network of the same shape to go on from (it is changed).
        grid, lookup: a hash grid to learn along (it is changed), and what it reads for each row.
    """
    with one_thread():
        return _trained(rows, books, clusters, shape, options, report, start, grid, lookup)


@contextmanager
def one_thread() -> Iterator[None]:
    """Torch on one thread: results of training do not depend on how many there are."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _trained(
    rows: IndexRows,
    books: Codebooks,
    clusters: Sequence[Sequence[int]],
    shape: NetworkShape,
    options: TrainOptions,
    report: Callable[[float], None],
    start: IndexModel | None,
    grid: BinaryGrid | None,
    lookup: Lookup | None,
) -> Trained:
    features = 0 if grid is None else sum(level.features for level in grid.levels)
    model = build(rows, books, clusters, shape, options.seed, features) if start is None else start
    examples, draw = Examples(rows, grid, lookup), np.random.default_rng(options.seed)
    steps = max(1, round(len(rows) / options.batch))
    descent = Descent(model, examples, options)
    schedule = _schedule(descent.optimiser, steps * options.epochs)
    history: list[float] = []
    for epoch in range(options.epochs):
        order = torch.from_numpy(draw.permutation(len(rows)))
        for number, chosen in enumerate(torch.tensor_split(order, steps)):
            descent.step(chosen, examples.sent / steps)
            schedule.step()
            report((epoch + (number + 1) / steps) / options.epochs)
        history.append(sum(_estimate(model, examples, options.quantised)))
        if _settled(history, options, epoch):
            break
    report(1.0)
    return Trained(model, history, *_estimate(model, examples, options.quantised))


def _network_bits(model: IndexModel, grid: BinaryGrid | None) -> torch.Tensor:
    return model.weight_bits() if grid is None else model.weight_bits() + grid.coded_bits()


def _groups(model: IndexModel, grid: BinaryGrid | None, learning_rate: float) -> list[dict[str, object]]:
    """Parameter groups: biases of logits are in bits and need longer steps."""
    betas = [p for name, p in model.named_parameters() if name.endswith("beta")]
    rest = [p for name, p in model.named_parameters() if not name.endswith("beta") and p.requires_grad]
    rest += [] if grid is None else list(grid.parameters())
    return [{"params": rest, "lr": learning_rate}, {"params": betas, "lr": 2 * learning_rate}]


def _schedule(optimiser: torch.optim.Optimizer, steps: int) -> torch.optim.lr_scheduler.LRScheduler:
    """One cycle: up for a tenth of the steps, then down to nothing along a cosine."""
    warm = max(1, steps // 10)

    def factor(step: int) -> float:
        if step < warm:
            return 0.1 + 0.9 * step / warm
        return 0.5 + 0.5 * float(np.cos(np.pi * min(1.0, (step - warm) / max(1, steps - warm))))

    return torch.optim.lr_scheduler.LambdaLR(optimiser, factor)


def _estimate(model: IndexModel, examples: Examples, exact: bool) -> tuple[float, float]:
    """Bits of the whole scene's indices, measured on some rows, and of the network with its grid."""
    with torch.no_grad():
        network = float(_network_bits(model, examples.grid))
    return float(measure(model, examples, exact, most=MEASURED_ROWS).sum()) * examples.scale, network


def _settled(history: list[float], options: TrainOptions, epoch: int) -> bool:
    """Whether the epochs left are not worth their time; asked in the last quarter only: short steps save most."""
    left = options.epochs - 1 - epoch
    if epoch < max(2 * SETTLED_EPOCHS, options.epochs * 3 // 4) or not left:
        return False
    # Single epochs are uneven, so the best of some are compared.
    gain = min(history[-2 * SETTLED_EPOCHS : -SETTLED_EPOCHS]) - min(history[-SETTLED_EPOCHS:])
    return gain / SETTLED_EPOCHS * left < 8 * options.patience

"""Training of the index network: what it codes plus what it costs, in bits, on a bounded budget.

The file pays for the network, so the loss is the bits of the indices plus those of the weights; trained on all rows
of a scene there is no overfitting that this sum does not show. Same rows, options and seed give the same network.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from reference_encoder.training.fixed_order import one_thread
from reference_encoder.training.networks.dataset import IndexRows, code_uses
from reference_encoder.training.networks.grid import BinaryGrid
from reference_encoder.training.networks.layers import NetworkShape
from reference_encoder.training.networks.model import Batch, IndexModel, input_scale
from reference_encoder.tuning import (
    INDEX_VISITS,
    LARGEST_BATCH,
    LAST_INDEX_LEARNING_RATE,
    MEASURED_ROWS,
    MOST_INDEX_EPOCHS,
    SETTLED_EPOCHS,
    SMALLEST_BATCH,
    STEEPEST,
)
from scarfmt.scene.model import Codebooks

_CHUNK = 4096
_PATIENCE_BYTES = 24


def last_epochs(rows: int) -> tuple[int, int]:
    """Epochs in which a network that learnt along with the scene is trained to its end on so many `rows`, and the rows
    of a batch."""
    epochs = int(np.clip(round(INDEX_VISITS / max(rows, 1)), 2, MOST_INDEX_EPOCHS))
    # At least some dozens of steps an epoch; beyond that, larger batches give steadier steps for little more time.
    batch = int(np.clip(1 << (max(rows, 1) // 60).bit_length(), SMALLEST_BATCH, LARGEST_BATCH))
    return epochs, batch


class Examples:
    """Rows as tensors, and a hash grid whose features are further inputs.

    Args:
        grid: learned along with the network.
    """

    def __init__(self, rows: IndexRows, grid: BinaryGrid | None = None) -> None:
        self._inputs, self._codes = torch.from_numpy(rows.inputs), torch.from_numpy(rows.codes.astype(np.int64))
        self._before, self._after = torch.from_numpy(rows.before), torch.from_numpy(rows.after)
        self.grid, self._lookup = grid, [] if grid is None else grid.lookup(rows.positions)
        self.sent = max(int((rows.after - rows.before).sum()), 1)
        self.scale = rows.symbols / self.sent

    def __len__(self) -> int:
        return len(self._before)

    def batch(self, chosen: torch.Tensor) -> Batch:
        """The rows `chosen`, (m,) int64."""
        inputs = self._inputs[chosen].float()
        if self.grid is not None:
            inputs = torch.cat([inputs, self.grid([(a[chosen], w[chosen]) for a, w in self._lookup])], 1)
        return inputs, self._before[chosen], self._after[chosen], self._codes[chosen]


def measure(model: IndexModel, examples: Examples, most: int | None = None) -> NDArray[np.float64]:
    """(M,) bits of the indices of every stage of the examples, or of about `most` spread over them, scaled up."""
    step = max(1, len(examples) // most) if most else 1
    totals, sent = np.zeros(model.stages), 0
    with torch.no_grad():
        for rows in torch.split(torch.arange(0, len(examples), step), _CHUNK):
            batch = examples.batch(rows)
            totals += [float(bits.double().sum()) for bits in model.bits(batch)]
            sent += int((batch[2] - batch[1]).sum())
    return totals * (examples.sent / max(sent, 1))


def build(rows: IndexRows, books: Codebooks, shape: NetworkShape, seed: int, grid_features: int = 0) -> IndexModel:
    """An untrained network for `rows`: right on average, knows nothing else."""
    model = IndexModel(shape, books, rows.codes.shape[1], input_scale(rows.inputs, grid_features), seed)
    for head, uses in zip(model.head, code_uses(rows, books.sizes), strict=False):
        head.start_from(uses)
    return model


class IndexOptimizer:
    """Steps of training by Adam, of a network and of the hash grid of its examples."""

    def __init__(self, model: IndexModel, examples: Examples, learning_rate: float) -> None:
        self.model, self.examples = model, examples
        # Fused: the network is small, and a call for every parameter and operation would take as long as its gradients.
        self.optimiser = torch.optim.Adam(_groups(model, examples.grid, learning_rate), fused=True)

    def step(self, chosen: torch.Tensor, expected: float) -> float:
        """One step on the rows `chosen`, (m,) int64, of which so many hold `expected` indices on average.

        The network's bits count as much as in a scene as large as the sample, which keeps it from learning a small
        sample by heart.

        Returns:
            Bits of the indices of these rows, over `expected`.
        """
        bits = torch.cat(self.model.bits(self.examples.batch(chosen))).sum() / expected
        loss = bits + 1 / self.examples.sent * _network_bits(self.model, self.examples.grid)
        self.optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), STEEPEST)
        self.optimiser.step()
        return float(bits.detach())


def train(
    model: IndexModel,
    examples: Examples,
    epochs: int,
    batch: int,
    seed: int,
    learning_rate: float = LAST_INDEX_LEARNING_RATE,
) -> list[float]:
    """Train a network and the hash grid of its examples, which are changed, by a one-cycle schedule.

    On one thread: sums of gradients, and with them the file, would depend on how many there are.

    Args:
        epochs: passes over the examples, at most.
        batch: rows a step.
        seed: of the order of rows.
        learning_rate: the highest.

    Returns:
        After each epoch the estimated bits of the whole scene's indices and of the network: too few where the examples
        are a small sample.
    """
    draw, steps = np.random.default_rng(seed), max(1, round(len(examples) / batch))
    history: list[float] = []
    with one_thread():
        descent = IndexOptimizer(model, examples, learning_rate)
        schedule = _schedule(descent.optimiser, steps * epochs)
        for epoch in range(epochs):
            order = torch.from_numpy(draw.permutation(len(examples)))
            for chosen in torch.tensor_split(order, steps):
                descent.step(chosen, examples.sent / steps)
                schedule.step()
            history.append(_estimate(model, examples))
            if _has_converged(history, epochs, epoch):
                break
    return history


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


def _estimate(model: IndexModel, examples: Examples) -> float:
    """Bits of the whole scene's indices, measured on some rows, and of the network with its grid."""
    with torch.no_grad():
        network = float(_network_bits(model, examples.grid))
    return float(measure(model, examples, most=MEASURED_ROWS).sum()) * examples.scale + network


def _has_converged(history: list[float], epochs: int, epoch: int) -> bool:
    """Whether the epochs left would, at the pace of the last, save too few bytes; asked in the last quarter only: short
    steps save most."""
    left = epochs - 1 - epoch
    if epoch < max(2 * SETTLED_EPOCHS, epochs * 3 // 4) or not left:
        return False
    # Single epochs are uneven, so the best of some are compared.
    gain = min(history[-2 * SETTLED_EPOCHS : -SETTLED_EPOCHS]) - min(history[-SETTLED_EPOCHS:])
    return gain / SETTLED_EPOCHS * left < 8 * _PATIENCE_BYTES

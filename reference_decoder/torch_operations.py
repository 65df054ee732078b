"""The evaluator's operations on torch, for the index network on a GPU (SPEC §10.1).

The results are those of NumPy, bit for bit: products of integers whose partial sums binary32 holds, and
binary64 where the frequency rule needs it. That holds only for true binary32 products, so a device that
shortens them (TF32, bfloat16) is refused.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from scarfmt.errors import Unsupported
from scarfmt.rans import TOTAL

F64 = NDArray[np.float64]
Ints = NDArray[np.integer[Any]]
Numbers = NDArray[np.integer[Any] | np.floating[Any]]
Tensor = torch.Tensor

_CHUNK_CPU = 4096
_CHUNK_DEVICE = 1 << 16
_PROBE = 128


class TorchOperations:
    """Operations (:mod:`scarfmt.neural.operations`) on tensors of one device.

    Args:
        device: as torch names it, "cpu" or "cuda".
        chunk: rows to work on at a time.

    Raises:
        Unsupported: ``inexact-device`` when its float32 products are not exact.
    """

    def __init__(self, device: str = "cpu", chunk: int | None = None) -> None:
        self._device = torch.device(device)
        self.chunk = chunk or (_CHUNK_CPU if self._device.type == "cpu" else _CHUNK_DEVICE)
        torch.backends.cuda.matmul.allow_tf32 = False
        # 4095 * 4097 = 2^24 - 1 needs all 24 bits of both factors and of the sum.
        left, right = np.zeros((_PROBE, _PROBE)), np.full((_PROBE, _PROBE), 4097)
        np.fill_diagonal(left, 4095)
        if not bool((self.product(self.constant(left), self.constant(right)) == (1 << 24) - 1).all()):
            raise Unsupported("inexact-device", f"float32 products on {device} are not exact", field="device")

    def constant(self, values: NDArray[Any]) -> Tensor:
        return torch.as_tensor(np.ascontiguousarray(values, dtype=np.float32), device=self._device)

    def lift(self, x: Numbers, amax: int) -> Tensor:
        return torch.as_tensor(x.astype(np.float32), device=self._device).clamp_(-amax, amax)

    def index(self, rows: Ints) -> Tensor:
        return torch.as_tensor(rows.astype(np.int64), device=self._device)

    def empty(self, rows: int, columns: int) -> Tensor:
        return torch.empty((rows, columns), dtype=torch.float32, device=self._device)

    def take(self, table: Tensor, rows: Tensor) -> Tensor:
        return table.index_select(0, rows)

    def product(self, x: Tensor, weights: Tensor) -> Tensor:
        return x @ weights

    def dots(self, a: Tensor, b: Tensor) -> Tensor:
        return (a * b).sum(dim=1)

    def floor_(self, x: Tensor) -> Tensor:
        return x.floor_()

    def clip_(self, x: Tensor, low: float, high: float) -> Tensor:
        return x.clamp_(low, high)

    def lookup_(self, table: Tensor, x: Tensor) -> Tensor:
        return table[x.clamp_(0, len(table) - 1).long()]

    def shares(self, scores: Tensor, exp2: Tensor) -> Tensor:
        weights = self.lookup_(exp2, scores.amax(dim=0) - scores).double()
        return (256 * weights / weights.sum(dim=0)).floor_().float()

    def frequency_rows(self, logits: Tensor, exp2: Tensor) -> F64:
        weights = self.lookup_(exp2, logits.amax(dim=0) - logits)
        prefix = weights.T.double().cumsum(dim=1)
        totals = prefix[:, -1:].clone()
        cumulative = (prefix.mul_(TOTAL - prefix.shape[1]) / totals).floor_()
        rows: F64 = torch.diff(cumulative, dim=1, prepend=torch.zeros_like(totals)).cpu().numpy()
        return rows

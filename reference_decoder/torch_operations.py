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

from scarfmt.arrays import F64, Ints, Numbers
from scarfmt.entropy.rans import TOTAL
from scarfmt.errors import Unsupported

Tensor = torch.Tensor

_CHUNK_CPU, _ELEMENTS_CPU = 2048, 1 << 17
_CHUNK_DEVICE, _ELEMENTS_DEVICE = 1 << 16, 1 << 24
_PROBE = 128
_SUMMED_TOGETHER = 64


class TorchOperations:
    """Operations (:mod:`scarfmt.neural.operations`) on tensors of one device.

    Args:
        device: as torch names it, "cpu" or "cuda".
        chunk: most rows to work on at a time.

    Raises:
        Unsupported: ``inexact-device`` when its float32 products are not exact.
    """

    def __init__(self, device: str = "cpu", chunk: int | None = None) -> None:
        self._device = torch.device(device)
        on_cpu = self._device.type == "cpu"
        self.chunk = chunk or (_CHUNK_CPU if on_cpu else _CHUNK_DEVICE)
        self.elements = _ELEMENTS_CPU if on_cpu else _ELEMENTS_DEVICE
        self._triangle = torch.ones((_SUMMED_TOGETHER, _SUMMED_TOGETHER), device=self._device).triu_()
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

    def lower(self, x: Tensor) -> NDArray[np.float32]:
        lowered: NDArray[np.float32] = x.cpu().numpy()
        return lowered

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

    def lookup_(self, table: Tensor, x: Tensor, origin: int = 0) -> Tensor:
        places = x.add_(origin).clamp_(0, len(table) - 1).long()
        # Four times faster than indexing.
        return table.index_select(0, places.flatten()).view(x.shape)

    def shares(self, scores: Tensor, exp2: Tensor) -> Tensor:
        weights = self.lookup_(exp2, scores.amax(dim=0) - scores).double()
        return (256 * weights / weights.sum(dim=0)).floor_().float()

    def frequency_rows(self, logits: Tensor, exp2: Tensor) -> F64:
        weights = self.lookup_(exp2, logits.amax(dim=0) - logits)
        cumulative = self._prefix_sums(weights)
        totals = cumulative[:, -1:].clone()
        cumulative.mul_(TOTAL - cumulative.shape[1]).div_(totals).floor_()
        rows = torch.empty_like(cumulative)
        # One long subtraction; what it puts in the first column is wrong.
        torch.sub(cumulative.view(-1)[1:], cumulative.view(-1)[:-1], out=rows.view(-1)[1:])
        rows[:, 0] = cumulative[:, 0]
        found: F64 = rows.cpu().numpy()
        return found

    def _prefix_sums(self, weights: Tensor) -> Tensor:
        """(n, k) float64 inclusive sums of (k, n) weights up to 2^16, over k: products with a triangle of ones."""
        sums = torch.empty(weights.shape[::-1], dtype=torch.float64, device=self._device)
        for first in range(0, len(weights), _SUMMED_TOGETHER):
            part = weights[first : first + _SUMMED_TOGETHER]
            last = first + len(part)
            sums[:, first:last] = part.T @ self._triangle[: len(part), : len(part)]
            if first:
                sums[:, first:last] += sums[:, first - 1 : first]
        return sums

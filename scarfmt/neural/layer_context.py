"""What the coders of one tile-layer may look at: values already decoded (SPEC §10.2).

Encoder and decoder fill it in alike, channel by channel.
"""

from __future__ import annotations

import ctypes
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.counters import Counters
from scarfmt.directory import TileFrame
from scarfmt.kernel.cells import KernelCellSums
from scarfmt.model import SceneModel
from scarfmt.morton import deinterleave
from scarfmt.neural.context import CellMeans, depth_shifts, fine, passes
from scarfmt.observe import LayerObserver

I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
U64 = NDArray[np.uint64]
Ints = NDArray[np.integer[Any]]


class LayerContext:
    """Decoded context of the anchors known in one layer of one tile.

    Args:
        model: of the file.
        frame: the tile's.
        codes: (n,) uint64 local Morton codes.
        classes: (n,) int64.
        observer: of the tile-layer, if there is one.
        counters: of what networks compute from it, if it is counted.
    """

    def __init__(
        self,
        model: SceneModel,
        frame: TileFrame,
        codes: U64,
        classes: I64,
        observer: LayerObserver | None = None,
        counters: Counters | None = None,
    ) -> None:
        self.model = model
        self.classes = classes
        self.observer = observer
        self.counters = counters
        self._frame = frame
        self._codes = codes
        self._settled: dict[int, tuple[Ints, I64]] = {}
        self._fine: dict[int, I64] = {}

    # Made when first asked for: in many layers nothing looks around.
    @cached_property
    def _order(self) -> I64:
        return np.argsort(self._codes, kind="stable")

    @cached_property
    def _rows(self) -> I64:
        """Rows of `cells` are anchors by (code, index): that of each anchor."""
        rows = np.empty_like(self._order)
        rows[self._order] = np.arange(len(rows))
        return rows

    @cached_property
    def cells(self) -> CellMeans:
        """The cells of the anchors known."""
        ordered = self._codes[self._order]
        return CellMeans(ordered, depth_shifts(ordered, self._frame.bits, self.model.context.occupancies))

    def __len__(self) -> int:
        return len(self.classes)

    def settle(self, channel: int, values: Ints, steps: I64) -> None:
        """Take the (n, components) `values` of a channel, at (n,) `steps`, as this layer leaves them: they stay so."""
        self._settled[channel] = values, steps

    def settled(self, before: int | None = None) -> I64:
        """(n, A) int64 fine values of the attribute channels settled, or of those before channel `before`."""
        chosen = [k for k in self.model.attributes if before is None or k < before]
        for channel in chosen:
            if channel not in self._fine:
                self._fine[channel] = fine(*self._settled[channel])
        if not chosen:
            return np.zeros((len(self), 0), np.int64)
        return np.concatenate([self._fine[channel] for channel in chosen], axis=1)

    def kernel_sums(self, library: ctypes.CDLL, columns: int) -> KernelCellSums:
        """Sums over the cells, compiled, of no anchors yet; anchors go by their own number, not their row."""
        return self.cells.kernel_sums(library, columns, self._anchor_cells)

    @cached_property
    def _anchor_cells(self) -> list[I32]:
        return [cell[self._rows] for cell in self.cells.compact]

    def rows(self, anchors: I64) -> I64:
        """The rows of some anchors in :attr:`cells`."""
        return self._rows[anchors]

    def parts(self, group: I64) -> list[I64]:
        """The anchors of a group, pass by pass, each by (code, index)."""
        ranked = self._order[np.sort(self._rows[group])]
        return [ranked[part] for part in passes(len(ranked), self.model.context.passes_log2)]

    def lattice_positions(self, anchors: I64) -> I64:
        """(m, 3) int64 lattice coordinates of the cell centres of some anchors (SPEC §10.6)."""
        return cell_centres(self._frame, self._codes[anchors])


def cell_centres(frame: TileFrame, codes: U64) -> I64:
    """(n, 3) int64 lattice coordinates of the centres of the cells with (n,) local `codes` (SPEC §10.6)."""
    local = deinterleave(codes).astype(np.int64)
    return np.asarray(np.array(frame.corner, np.int64) + (local << frame.shift) + ((1 << frame.shift) >> 1))

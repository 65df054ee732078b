"""The decoded values that the coders of one tile-layer may use (SPEC §10.2).

Encoder and decoder fill it in alike, channel by channel.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from scarfmt.arrays import I32, I64, U64, Ints
from scarfmt.container.directory import TileFrame
from scarfmt.container.morton import deinterleave
from scarfmt.neural.context import Cells, CellSums, depth_shifts, passes, put_fine
from scarfmt.observe import LayerObserver
from scarfmt.scene.model import SceneModel


class LayerContext:
    """Decoded context of the anchors known in one layer of one tile.

    Args:
        codes: (n,) uint64 local Morton codes.
        classes: (n,) int64.
        observer: of the tile-layer, if there is one.
    """

    def __init__(
        self,
        model: SceneModel,
        frame: TileFrame,
        codes: U64,
        classes: I64,
        observer: LayerObserver | None = None,
    ) -> None:
        self.model = model
        self.codes = codes
        self.frame = frame
        self.classes = classes
        self.observer = observer
        self._settled: dict[int, tuple[Ints, I64]] = {}
        self._fine_channels: set[int] = set()

    # Made when first asked for: in many layers nothing looks around.
    @cached_property
    def by_code(self) -> I64:
        """(n,) anchors by (code, index)."""
        return np.argsort(self.codes, kind="stable")

    @cached_property
    def _rows(self) -> I64:
        """Rows of `cells` are anchors by (code, index): that of each anchor."""
        rows = np.empty_like(self.by_code)
        rows[self.by_code] = np.arange(len(rows))
        return rows

    @cached_property
    def cells(self) -> Cells:
        """The cells of the anchors known."""
        ordered = self.codes[self.by_code]
        return Cells(ordered, depth_shifts(ordered, self.frame.bits, self.model.context.occupancies))

    def __len__(self) -> int:
        return len(self.classes)

    def settle(self, channel: int, values: Ints, steps: I64) -> None:
        """Take the (n, components) `values` of a channel, at (n,) `steps`, as this layer leaves them: they stay so."""
        self._settled[channel] = values, steps

    def list_settled(self, before: int | None = None) -> I32:
        """(n, A) int32 fine values of the attribute channels settled, or of those before channel `before`.

        They are the first columns of an array of all attribute channels.
        """
        end = 0
        for channel in self.model.attributes:
            if before is not None and channel >= before:
                break
            start, end = end, end + self.model.channels[channel].components
            if channel not in self._fine_channels:
                put_fine(*self._settled[channel], self._fine[:, start:end])
                self._fine_channels.add(channel)
        return self._fine[:, :end]

    @cached_property
    def _fine(self) -> I32:
        return np.empty((len(self), sum(self.model.channels[k].components for k in self.model.attributes)), np.int32)

    def sums(self, columns: int) -> CellSums:
        """Sums over :attr:`cells`, of no anchors yet, `columns` values each."""
        return CellSums(self.cells, columns)

    def rows(self, anchors: I64) -> I64:
        """The rows of some anchors in :attr:`cells`."""
        return self._rows[anchors]

    def parts(self, cohort: I64) -> list[I64]:
        """The anchors of a cohort, pass by pass, each by (code, index)."""
        ranked = self.by_code[np.sort(self._rows[cohort])]
        return [ranked[part] for part in passes(len(ranked), self.model.context.passes_log2)]


def cell_centres(frame: TileFrame, codes: U64) -> I64:
    """(n, 3) int64 lattice coordinates of the centres of the cells with (n,) local `codes` (SPEC §10.6)."""
    local = deinterleave(codes).astype(np.int64)
    return np.asarray(np.array(frame.corner, np.int64) + (local << frame.shift) + ((1 << frame.shift) >> 1))

"""The values that a decoder knows of a tile in one layer, as plain integers (SPEC §6.5, §7.5)."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Tile
from scarfmt.container.schema import Profile
from scarfmt.scene.model import SceneModel


class Anchors:
    """The anchors of a tile that are known after a layer; those that appear in it are the last.

    Attributes:
        new: how many appear in this layer.
        codes, classes: of each.
        slot_layers: of each, the layer that turned each slot on, up to this layer; else 0.
        index: of each, codewords of the stages 1.. of the whole scene; stage 0 stands for none.
    """

    def __init__(self, scene: QuantisedScene, number: int, layer: int) -> None:
        self.model: SceneModel = scene.model
        self.layer = layer
        self.tile: Tile = scene.tiles[number]
        content = scene.contents[number]
        past, before = self.class_count(layer), self.class_count(layer - 1)
        known = int((content.classes < past).sum())
        self.codes: list[int] = content.codes[:known].tolist()
        self.classes: list[int] = content.classes[:known].tolist()
        self.new = sum(c >= before for c in self.classes)
        self.index: list[list[int]] = [[0, *row] for row in content.indices[:known].tolist()]
        self.slot_layers: list[list[int]] = []
        if scene.fields.profile == Profile.ANCHOR:
            slots = content.slot_layers[:known]
            self.slot_layers = np.where(slots > layer, 0, slots).tolist()
        self._values = [values[:known].astype(np.int64) for values in content.values]
        self._at: dict[tuple[int, int], list[list[int]]] = {}

    def class_count(self, layer: int) -> int:
        """C(k)."""
        return self.model.layers[layer - 1].class_count if layer else 0

    def stages(self, layer: int) -> list[int]:
        """Stages of each anchor after a layer."""
        row = self.model.layers[layer - 1].stages if layer else ()
        return [row[c] if c < len(row) else 0 for c in self.classes]

    def steps(self, layer: int, channel: int) -> list[int]:
        """Steps of a channel of each anchor after a layer."""
        row = self.model.layers[layer - 1].steps if layer else ()
        return [row[c][channel] if c < len(row) else 0 for c in self.classes]

    @cached_property
    def _last(self) -> int:
        return len(self.model.layers)

    def at(self, channel: int, n: int) -> list[list[int]]:
        """The components of a channel after n steps of each anchor that gets so many: the nearest of coarser cells."""
        if (channel, n) not in self._at:
            values = self._values[channel]
            final = np.array(self.steps(self._last, channel), np.int64)
            power = 3 ** np.maximum(final - max(n, 1), 0)[:, None]
            nearest: NDArray[np.int64] = (values + power // 2) // power if n else 0 * values
            self._at[channel, n] = nearest.tolist()
        return self._at[channel, n]

    def offset(self, channel: int, anchor: int, slot: int) -> list[int]:
        """The three numbers of a slot."""
        out: list[int] = self._values[channel][anchor, slot].tolist()
        return out

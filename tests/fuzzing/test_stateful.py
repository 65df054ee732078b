"""Files through a life of cuts and additions, beside a model of plain arrays."""

from __future__ import annotations

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from numpy.typing import NDArray

from conformance.surgery.files import blocks_of, rebuilt
from fuzz.testing.strategies import scenes
from reference_decoder.decode import decode
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.file import Block
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.container.source import BytesSource
from scarfmt.tools.inspection import inspect
from scarfmt.tools.truncate import truncate
from scarfmt.tools.validate import validate

SAFE_TO_COPY = 2
FIRST_FREE = BlockKind.STREAMING + 1
"""Kinds from here on mean nothing to a reader."""
TEXTS = st.binary(min_size=1, max_size=50)


def coarse(values: NDArray[np.int32], drop: NDArray[np.int64]) -> NDArray[np.int64]:
    """Integers to the nearest multiple of 3^drop, in units of it: no ties, as 3 is odd."""
    power = 3 ** drop.astype(np.int64)
    return np.asarray(np.floor(values.astype(np.float64) / power + 0.5), np.int64)


class FileLife(RuleBasedStateMachine):
    """A file, the scene it was made of, how many layers are left, and the annotations it should carry."""

    def __init__(self) -> None:
        super().__init__()
        self.data = b""
        self.layers = 0
        self.notes: dict[tuple[int, int], tuple[int, bytes]] = {}

    @initialize(scene=scenes(max_anchors=25, max_layers=4))
    def encode(self, scene: QuantisedScene) -> None:
        self.scene = scene
        self.data = write_scene(scene)
        self.layers = len(scene.model.layers)

    @precondition(lambda self: self.layers > 0)
    @rule(data=st.data())
    def cut(self, data: st.DataObject) -> None:
        layers = data.draw(st.integers(1, self.layers))
        before = self.data
        self.data = truncate(BytesSource(before), layers)
        assert truncate(BytesSource(self.data), layers) == self.data
        whole = decode(before, layers=layers)
        assert all(map(np.array_equal, decode(self.data).arrays(), whole.arrays()))
        cut = layers < self.layers
        self.notes = {
            place: note
            for place, note in self.notes.items()
            if place[0] <= layers and (not cut or note[0] == SAFE_TO_COPY)
        }
        self.layers = layers

    @precondition(lambda self: self.layers > 0)
    @rule(data=st.data(), kind=st.integers(FIRST_FREE, 255), flags=st.sampled_from([0, SAFE_TO_COPY]), text=TEXTS)
    def annotate(self, data: st.DataObject, kind: int, flags: int, text: bytes) -> None:
        layer = data.draw(st.integers(1, self.layers))
        kept = [block for block in blocks_of(self.data) if (block.layer, block.kind) != (layer, kind)]
        self.data = rebuilt(self.data, [*kept, Block(kind, layer, text, flags=flags)])
        self.notes[layer, kind] = flags, text

    @precondition(lambda self: self.layers > 0)
    @rule()
    def inspected(self) -> None:
        report = inspect(BytesSource(self.data), metadata=True)
        assert (report["layer_count"], report["file_bytes"]) == (self.layers, len(self.data))
        assert report["anchors"] == sum(len(tile) for tile in self.expected())
        assert (report["metadata"] or {}) == self.scene.metadata

    @invariant()
    def notes_are_kept(self) -> None:
        if self.layers:
            notes = [block for block in blocks_of(self.data) if block.kind >= FIRST_FREE]
            found = {(note.layer, note.kind): (note.flags, note.payload) for note in notes}
            assert found == self.notes

    @precondition(lambda self: self.layers > 0)
    @rule()
    def decoded(self) -> None:
        assert validate(BytesSource(self.data)).valid
        reader = SceneReader(BytesSource(self.data))
        for (_, found), wanted in zip(reader.tiles(reader.models()), self.expected(), strict=True):
            self.compare(found, wanted)

    def expected(self) -> list[TileContent]:
        """The tiles of the scene, of anchors that have appeared."""
        past = self.scene.model.layers[self.layers - 1].class_count
        return [content.head(int((content.classes < past).sum())) for content in self.scene.contents]

    def compare(self, found: TileContent, wanted: TileContent) -> None:
        """Compare the values of a decoder with those of the scene, rounded to the steps that have travelled."""
        rows, last = self.scene.model.layers, self.scene.model.layers[-1]
        assert np.array_equal(found.codes, wanted.codes)
        assert np.array_equal(found.classes, wanted.classes)
        row = rows[self.layers - 1]
        on = (wanted.slot_layers > 0) & (wanted.slot_layers <= self.layers)
        assert np.array_equal(found.slot_layers, wanted.slot_layers * on)
        for index, channel in enumerate(self.scene.model.channels):
            if channel.stream == Stream.OFFSETS:
                assert np.array_equal(found.values[index], wanted.values[index] * on[:, :, None])
                continue
            steps, all_steps = (
                np.array([r.steps[kind][index] for kind in wanted.classes], np.int64).reshape(-1, 1)
                for r in (row, last)
            )
            values = coarse(wanted.values[index], np.maximum(all_steps - np.maximum(steps, 1), 0))
            assert np.array_equal(found.values[index], values * (steps > 0))
        for anchor, kind in enumerate(wanted.classes):
            stages = row.stages[kind]
            assert found.indices[anchor, :stages].tolist() == wanted.indices[anchor, :stages].tolist()
            assert not found.indices[anchor, stages:].any()


TestFileLife = FileLife.TestCase
TestFileLife.settings = settings(
    deadline=None, max_examples=6, stateful_step_count=6, suppress_health_check=list(HealthCheck)
)

"""The edge vectors reach the edges that they claim. That decoders agree on them is tested with all vectors."""

from __future__ import annotations

from functools import cache

import pytest

from conformance.decoders.python.answers import Answers
from conformance.decoders.python.decoder import Decoder
from conformance.faults.table_records import Record, unpacked
from conformance.scenes.cases import Case
from conformance.scenes.edge_scenes import edge_cases
from conformance.surgery.files import blocks_of, content_of, tile_parts
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.schema import BlockKind, Stream


@cache
def cases() -> dict[str, Case]:
    return {case.id.removeprefix("edge/"): case for case in edge_cases()}


def scene(name: str) -> QuantisedScene:
    found = cases()[name].scene
    assert found is not None
    return found


def streams(name: str) -> list[set[Stream]]:
    """The sub-streams with bytes of each TILE block."""
    return [set(tile_parts(b.payload)) for b in blocks_of(cases()[name].data) if b.kind == BlockKind.TILE]


def tables(name: str) -> list[Record]:
    return [r for b in blocks_of(cases()[name].data) if b.kind == BlockKind.TABLES for r in unpacked(content_of(b))]


def test_every_case_has_a_scene_and_rules() -> None:
    """The manifest needs both; and no case is so large that it decides the size of the suite."""
    for case in cases().values():
        assert case.scene is not None
        assert case.rules
        assert len(case.data) < 80_000


def test_first_symbols_take_no_bytes() -> None:
    """Though no table has just one symbol: the empty stream stands for them."""
    assert streams("first-symbols") == [set()]
    assert all(len(record.values) > 1 for record in tables("first-symbols"))
    assert Stream.INDICES not in streams("index-first-symbols")[0]


@pytest.mark.parametrize(("name", "blocks"), [("layers-still", 1), ("tiles-empty-blocks", 9)])
def test_layers_that_change_nothing(name: str, blocks: int) -> None:
    """With TILE blocks, and without."""
    assert len(streams(name)) == blocks


def test_codes_and_values_reach_both_ends() -> None:
    """Codes of 64 bits and values of 32 bits reach both ends of their ranges."""
    assert [int(c) for c in scene("spine").contents[0].codes[[0, 1, -1]]] == [0, 1, 1 << 62]
    assert int(scene("last-cell").contents[0].codes[0]) == (1 << 63) - 1
    for name in ("values-limit", "alphabet-extremes", "steps-extreme"):
        values = scene(name).contents[0].values[0]
        assert (int(values.min()), int(values.max())) == (1 - (1 << 31), (1 << 31) - 1)


def test_tables_at_their_largest() -> None:
    """4096 symbols, and weights of 2^24 - 1."""
    largest = [record for record in tables("alphabet-4096") if len(record.values) == 4096]
    assert sorted(max(record.weights) for record in largest) == [1, (1 << 24) - 1, (1 << 24) - 1]


def test_anchors_whose_slots_are_all_on_have_no_masks_left() -> None:
    """Layer 2 would send them; where none is ever on, both layers do."""
    layers = scene("anchors-slots-on").contents[0].slot_layers
    assert set(layers.ravel().tolist()) == {1}
    assert not scene("anchors-slots-off").contents[0].slot_layers.any()


def test_inputs_of_exact_models_show_their_ends() -> None:
    """Contexts of an input at 511 and at -511, and embeddings of one at 127."""
    trace = Answers(Decoder(cases()["predictors-exact"].data)).trace
    seen = trace.contexts[int(Stream.SCALE), 1, 1]
    assert {8 * 16, 8} <= set(seen)
    embedded = Answers(Decoder(cases()["index-exact"].data)).trace.embedded
    assert max(max(row) for row in embedded) == 127 - 10

"""The writer of the conformance suite: its files hold the scene; with its tables they are the reference writer's."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from conformance.decoders.python.decoder import Decoder
from conformance.scenes.made import build, static_plans, worked_scene
from conformance.scenes.neural_scenes import neural_plans
from conformance.surgery.files import COMPRESSED, blocks_of, content_of
from conformance.writer import (
    BlockForm,
    FrameStyle,
    Renewal,
    RiceStyle,
    Table,
    Weights,
    WriteOptions,
    write_container,
    write_file,
)
from conformance.writer.substream import MissingTable
from fuzz.testing.scenes import random_scene
from fuzz.testing.strategies import neural_scenes, quantised_scenes
from scarfmt.blocks.tables import unpack_tables
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene, keep_layers, layer_counts, write_scene
from scarfmt.container.file import Block, Container
from scarfmt.container.file import write_container as reference_container
from scarfmt.container.schema import BlockKind, Profile
from scarfmt.container.source import BytesSource
from scarfmt.limits import FORMAT_LIMITS
from scarfmt.tools.truncate import truncate
from scarfmt.tools.validate import validate
from tests.samples.contents import read_everything

PLANS = {**static_plans(), **neural_plans()}
UNKNOWN_KEYS = {0: Table((0,), (1,)), 0xFFFFFFFF: Table((-(2**31) + 1, 2**31 - 1), (2**24 - 1, 1))}


def framed(style: FrameStyle) -> WriteOptions:
    return WriteOptions(frames=dict.fromkeys(COMPRESSED, style))


OPTIONS = {
    "runs": framed(FrameStyle(BlockForm.RUNS, size_bytes=4, dictionary_bytes=1)),
    "literals": framed(FrameStyle(BlockForm.LITERALS, window=0, empty_end=True)),
    "matches": framed(FrameStyle(BlockForm.MATCHES, size_bytes=8, window=3, dictionary_bytes=4)),
    "many-blocks": framed(FrameStyle(most=7, window=0x68, dictionary_bytes=2)),
    "rice-raised": WriteOptions(rice=RiceStyle(raised=3, most_shift=0, zero_shift=31)),
    "rice-lowest": WriteOptions(rice=RiceStyle(raised=-31, most_shift=1)),
    "idle-tables": WriteOptions(tables={1: UNKNOWN_KEYS}),
    "tables-again": WriteOptions(renewal=Renewal.REPEATED),
    "tables-new": WriteOptions(renewal=Renewal.ALWAYS),
    "uniform": WriteOptions(weights=Weights.UNIFORM),
    "reversed": WriteOptions(weights=Weights.REVERSED),
    "steep": WriteOptions(weights=Weights.STEEP),
    "unused": WriteOptions(unused=(-(2**31) + 1, 0, 2**31 - 1)),
    "empty-tiles": WriteOptions(empty_tiles=True),
    "wide-weights": WriteOptions(wide_weights=True),
    "class-columns": WriteOptions(class_columns=15),
    "grid-ones": WriteOptions(grid_ones=255),
    "metadata": WriteOptions(metadata=b' { "b" : 1 , "a" : [ ] , "a" : {} } '),
    "blocks": WriteOptions(
        blocks=(Block(9, 1, b"x", flags=1), Block(66, 1, b"y"), Block(130, 1, b"z", flags=2, count=7))
    ),
}


@lru_cache
def scene_of(name: str) -> QuantisedScene:
    return build(PLANS[name][1])


def same(found: TileContent, expected: TileContent) -> bool:
    """Whether two tiles hold the same numbers, whatever their types."""
    names = ("codes", "classes", "indices", "slot_layers")
    alike = all(np.array_equal(getattr(found, name), getattr(expected, name)) for name in names)
    return alike and all(np.array_equal(a, b) for a, b in zip(found.values, expected.values, strict=True))


def check(data: bytes, scene: QuantisedScene) -> None:
    """The reference reader finds the scene, to every layer; the file keeps all rules, (V) rules too."""
    for layer in range(1, len(scene.model.layers) + 1):
        reader, kept = SceneReader(BytesSource(data), limits=FORMAT_LIMITS), keep_layers(scene, layer)
        found = [content for _, content in reader.tiles(reader.models(layer))]
        assert len(found) == len(kept.contents)
        assert all(map(same, found, kept.contents))
    findings = validate(BytesSource(data), limits=FORMAT_LIMITS).findings
    assert [finding for finding in findings if finding.severity == "error"] == []


def check_minimal(data: bytes, scene: QuantisedScene) -> None:
    """The decoder written from SPEC.md finds the scene, too."""
    decoder = Decoder(data)
    for number, content in enumerate(scene.contents):
        tile, stages = decoder.tile(number), content.indices.shape[1]
        assert tile.code == content.codes.tolist()
        assert tile.klass == content.classes.tolist()
        assert tile.v == [values.tolist() for values in content.values]
        assert [row[1 : stages + 1] for row in tile.index] == content.indices.tolist()


def reference_parts(scene: QuantisedScene) -> tuple[bytes, WriteOptions]:
    """The reference writer's file with stored frames, and options to send the tables it chose."""
    blocks, tables, stored = blocks_of(write_scene(scene)), {}, []
    for block in blocks:
        if block.kind == BlockKind.TABLES:
            found = unpack_tables(content_of(block))
            tables[block.layer] = {
                key.number: Table(tuple(t.alphabet.tolist()), tuple(t.weights.tolist())) for key, t in found.items()
            }
        stored.append(replace(block, payload=FrameStyle()(content_of(block))) if block.kind in COMPRESSED else block)
    data = reference_container(scene.fields, scene.tiles, stored, layer_counts(scene))
    return data, WriteOptions(fitted=False, tables=tables)


@pytest.mark.parametrize(
    "name",
    ["explicit-refined", "duplicates", "lattice-32", "anchors-32-slots", "predictors", "index-grid", "index-modes"],
)
def test_both_decoders_find_the_scene(name: str) -> None:
    """With tables of the writer's own choice; the tests of the vectors do the same for all."""
    data = write_file(scene_of(name))
    check(data, scene_of(name))
    check_minimal(data, scene_of(name))


@pytest.mark.parametrize("name", PLANS)
def test_with_its_tables_the_file_is_the_reference_writers(name: str) -> None:
    """Byte for byte: all but the choice of tables and frames follows from the scene."""
    expected, options = reference_parts(scene_of(name))
    assert write_file(scene_of(name), options) == expected


def test_the_worked_file_does_not_depend_on_who_writes_it() -> None:
    """SPEC.md, appendix B, prints these bytes; the weight rule agrees with the reference writer's there."""
    assert write_file(worked_scene()) == reference_parts(worked_scene())[0]


@settings(deadline=None, max_examples=25)
@given(quantised_scenes() | neural_scenes(max_anchors=25, max_layers=3), st.sampled_from(sorted(OPTIONS)))
def test_random_scenes_come_back_however_they_are_written(scene: QuantisedScene, name: str) -> None:
    """Both profiles come back, with and without networks. With every option the file keeps all rules."""
    options = OPTIONS[name]
    if name == "blocks":
        options = replace(options, blocks=options.blocks[1:])
    data = write_file(scene, options)
    assert all(map(same, read_everything(data), scene.contents))
    check(data, scene)


@settings(deadline=None, max_examples=10)
@given(quantised_scenes(max_layers=5), st.integers(1, 4))
def test_nothing_in_a_layer_depends_on_later_ones(scene: QuantisedScene, layers: int) -> None:
    """A file cut by an editor has the bytes of one written with fewer layers (SPEC §14)."""
    kept = min(layers, len(scene.model.layers))
    assert truncate(BytesSource(write_file(scene)), kept) == write_file(keep_layers(scene, kept))


@pytest.mark.parametrize("name", sorted(set(OPTIONS) - {"blocks"}))
def test_options_change_the_file_and_not_the_scene(name: str) -> None:
    """Each option shows in the bytes of a scene that has what it is about."""
    neural = name.startswith(("rice-", "class-", "grid-"))
    scene = scene_of("anchors-neural" if neural else "explicit-refined")
    data = write_file(scene, OPTIONS[name])
    check(data, scene)
    check_minimal(data, scene)
    assert data != write_file(scene)


def test_blocks_of_any_kind_can_be_added() -> None:
    """A critical one of an unknown kind is what makes the file unreadable."""
    data = write_file(scene_of("annotations"), OPTIONS["blocks"])
    container = Container.open(BytesSource(data), readable_kinds=range(256)).load()
    found = {(e.kind, e.tile, e.flags, e.count) for e in container.entries}
    assert {(9, None, 1, 0), (66, None, 0, 0), (130, None, 2, 7)} <= found
    with pytest.raises(Exception, match="kind"):
        Container.open(BytesSource(data)).load()


@pytest.mark.parametrize("page_bits", [0, 1, 10])
def test_blocks_are_put_in_order_and_in_pages_as_the_reference_writer_does(page_bits: int) -> None:
    """Two writers of ROOT and pages that share no code agree on a scene of many tiles."""
    scene = scene_of("explicit-refined")
    blocks = blocks_of(write_file(scene, WriteOptions(page_bits=page_bits)))
    ours = write_container(scene.fields, scene.tiles, blocks[::-1], layer_counts(scene), page_bits=page_bits)
    assert ours == write_file(scene, WriteOptions(page_bits=page_bits))
    assert ours == reference_container(scene.fields, scene.tiles, blocks, layer_counts(scene), page_bits)


def test_tables_that_lack_a_value_are_told() -> None:
    """A mistake in the options of a vector, not a broken file."""
    with pytest.raises(MissingTable):
        write_file(worked_scene(), WriteOptions(fitted=False))


def test_a_scene_without_anchors_has_tile_blocks_if_asked() -> None:
    """R-7.1-7 is a SHOULD: blocks of five bytes."""
    scene = random_scene(3, Profile.ANCHOR, anchors=0, layers=2, tiles=2)
    tiles = [block for block in blocks_of(write_file(scene, OPTIONS["empty-tiles"])) if block.kind == BlockKind.TILE]
    assert [len(block.payload) for block in tiles] == [5] * 4
    check(write_file(scene, OPTIONS["empty-tiles"]), scene)

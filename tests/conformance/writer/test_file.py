"""What the suite packs by itself is what the package packs: ROOT and pages; and its files are those of the package."""

from __future__ import annotations

from functools import lru_cache

import pytest

from conformance.scenes.edge_scenes import edge_cases
from conformance.scenes.made import build, static_plans, worked_scene
from conformance.scenes.neural_scenes import neural_plans
from conformance.surgery.files import blocks_of, rebuilt
from conformance.writer.file import write_file
from conformance.writer.options import WriteOptions
from scarfmt.blocks.tables import unpack_tables
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import QuantisedScene, layer_counts, write_scene
from scarfmt.container.file import write_container
from scarfmt.container.schema import BlockKind
from scarfmt.container.source import BytesSource
from tests.samples.equality import same

PLANS = {**static_plans(), **neural_plans()}


@lru_cache
def scene_of(name: str) -> QuantisedScene:
    return build(PLANS[name][1])


def reference_parts(scene: QuantisedScene) -> tuple[bytes, WriteOptions]:
    """The reference writer's file, and options to send the tables it chose."""
    data = write_scene(scene)
    tables = {b.layer: unpack_tables(b.payload) for b in blocks_of(data) if b.kind == BlockKind.TABLES}
    return data, WriteOptions(fitted=False, tables=tables)


@pytest.mark.parametrize("name", PLANS)
def test_with_its_tables_the_file_is_the_reference_writers(name: str) -> None:
    """Byte for byte: all but the choice of tables follows from the scene."""
    expected, options = reference_parts(scene_of(name))
    assert write_file(scene_of(name), options) == expected


def test_scenes_at_the_edges_of_the_format_are_packed_alike() -> None:
    """The largest and least models, tables and values are read as they were written."""
    wrong = []
    for case in edge_cases():
        scene = case.scene
        assert scene is not None
        expected, options = reference_parts(scene)
        models = SceneReader(BytesSource(expected)).models()
        found = models.codebooks, models.decoder, models.scene_mlps, models.network, models.grid
        sent = scene.codebooks, scene.decoder, scene.scene_mlps, scene.network, scene.grid
        predictors = {predictor.key: predictor for group in scene.predictors.values() for predictor in group}
        read = same(found, sent) and same(models.predictors[-1], predictors)
        if not read or write_file(scene, options) != expected:
            wrong.append(case.id)
    assert wrong == []


def test_the_worked_file_does_not_depend_on_who_writes_it() -> None:
    """SPEC.md §4.2 prints these bytes; the weight rule agrees with the reference writer's there."""
    assert write_file(worked_scene()) == reference_parts(worked_scene())[0]


@pytest.mark.parametrize("page_bits", [0, 1, 10])
def test_blocks_are_put_in_order_and_in_pages_as_the_reference_writer_does(page_bits: int) -> None:
    """Two writers of ROOT and pages that share no code agree on a scene of many tiles."""
    scene = scene_of("explicit-refined")
    data = write_file(scene, WriteOptions(page_bits=page_bits))
    blocks = blocks_of(data)
    assert rebuilt(data, blocks[::-1]) == data
    assert write_container(scene.fields, scene.tiles, blocks, layer_counts(scene), page_bits) == data

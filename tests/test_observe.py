"""Observers of a decode: what they are shown, and that looking changes nothing."""

from __future__ import annotations

import numpy as np
from scarfmt_conformance.reference.observed import LayerRecord, Records

from conformance.spec import worked_network
from fuzz.testing.neural_scenes import neural_scene
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Stream
from scarfmt.container.source import BytesSource
from scarfmt.entropy.emitters import SymbolWriter
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.neural.evaluator import Evaluator
from scarfmt.observe import ObservedReader
from tests.samples.equality import same


def test_looking_changes_nothing() -> None:
    """The integers are the same with observers of every layer of every tile as without."""
    reader = SceneReader(BytesSource(write_scene(neural_scene(28, anchors=200, tiles=5))))
    models = reader.models()
    watched = reader.tiles(models, observe=lambda tile, layer: LayerRecord())
    for (tile, plain), (other, seen) in zip(reader.tiles(models), watched, strict=True):
        assert tile == other
        assert same(plain, seen)


def test_embeddings_are_those_of_the_specification() -> None:
    """SPEC appendix C.2: h of the worked network is 53 9."""
    evaluator = Evaluator(worked_network.worked_network(), worked_network.BOOKS)
    assert evaluator.embed(np.array([[64, 10, -65, 312]])).tolist() == [[53, 9]]


def test_a_reader_tells_the_frequencies_of_every_group() -> None:
    """A table of one symbol counts, too, although it reads nothing; a group without symbols does not count."""
    key, sure = TableKey(Stream.INDICES, 2, 0, 3), TableKey(Stream.INDICES, 1, 0, 0)
    tables = {key: SymbolTable(np.array([-1, 4]), np.array([3, 1])), sure: SymbolTable(np.array([7]), np.array([5]))}
    writer = SymbolWriter(tables)
    writer.emit(key, np.array([4, -1]))
    writer.emit_uniform(2, np.array([1]))
    record = LayerRecord()
    reader = ObservedReader(writer.finish(), tables, Stream.INDICES, record)
    assert reader.read(sure, 0).tolist() == reader.read_uniform(3, 0).tolist() == []
    assert not record.tables
    assert reader.read(sure, 2).tolist() == [7, 7]
    assert reader.read(key, 2).tolist() == [4, -1]
    assert reader.read_uniform(2, 1).tolist() == [1]
    reader.finish()
    # c_1 = 3 * (2^24 - 2) // 4 + 1
    assert {name: table.tolist() for name, table in record.tables.items()} == {
        "frequencies.INDICES.1": [1 << 24],
        "frequencies.INDICES.2": [12582911, 4194305],
        "frequencies.INDICES": [1 << 23, 1 << 23],
    }


def test_records_are_put_together_tile_by_tile() -> None:
    """Whatever the order in which threads came to them; of frequencies the first tile's count."""
    records = Records(2)
    assert records.observe(0, 1) is None
    for tile, number in ((5, 50), (3, 30)):
        record = records.observe(tile, 2)
        assert record is not None
        record.contexts(Stream.SCALE, 0, 1, np.array([number, number + 1]))
        record.contexts(Stream.SCALE, 1, 1, np.array([], np.int64))
        record.frequencies(Stream.SCALE, 0, np.array([number]))
    assert {name: rows.tolist() for name, rows in records.contexts().items()} == {"context.SCALE.0.1": [30, 31, 50, 51]}
    assert records.frequencies()["frequencies.SCALE"].tolist() == [30]

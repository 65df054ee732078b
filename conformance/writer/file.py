"""Whole files from scenes, and from blocks (SPEC §5).

Models are packed, and symbols recorded and coded, by the package's writer; which tables are sent, ROOT and pages are
chosen and packed here. That a file says what its scene holds is the readable decoder's to find
(:mod:`conformance.expect.document`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from conformance.decoders.python.front import NO_TILE, SIGNATURE
from conformance.surgery.parts import Parts, Row
from conformance.writer.options import Tables, WriteOptions
from conformance.writer.tables import layer_tables
from scarfmt.coding.writer import QuantisedScene, layer_counts, model_blocks, record_tile
from scarfmt.container.directory import required_flags
from scarfmt.container.file import Block
from scarfmt.container.schema import BlockKind
from scarfmt.container.substreams import pack_substreams
from scarfmt.entropy.emitters import SymbolCounter
from scarfmt.entropy.symbol_tables import StaticTables

PLAIN = WriteOptions()
Counts = Sequence[tuple[int, int]]
"""Per layer, cumulative anchors and Gaussians."""


def count_rows(counts: Counts) -> list[Row]:
    """Layer summaries that say no more than the counts."""
    return [{"anchor_count": anchors, "gaussian_count": gaussians} for anchors, gaussians in counts]


def write_file(scene: QuantisedScene, options: WriteOptions = PLAIN) -> bytes:
    """The bytes of a file. Nothing is checked: a scene that breaks a rule may give a file that does.

    Raises:
        InvalidInput: ``input-symbol`` when the tables of the options do not code a symbol.
    """
    known: Tables = {}
    blocks = list(options.blocks)
    for layer in range(1, len(scene.model.layers) + 1):
        counter, neural = SymbolCounter(), scene.neural(layer)
        recorded = [record_tile(scene, layer, number, neural, counter) for number in range(len(scene.tiles))]
        counted = counter.histograms()
        sent = layer_tables(counted, known, layer, options)
        known = {**known, **sent}
        used = StaticTables({key: known[key] for key in counted if key in known})
        blocks += model_blocks(scene, layer, sent)
        for number, tile in enumerate(recorded):
            block = tile.block(layer, number, used)
            if block is not None or options.empty_tiles:
                blocks.append(block or Block(BlockKind.TILE, layer, pack_substreams({}), number))
    if options.metadata is not None:
        kept = [block for block in blocks if block.kind != BlockKind.METADATA]
        blocks = [*kept, Block(BlockKind.METADATA, 1, options.metadata)]
    header = {**vars(scene.fields), "signature": SIGNATURE, "major": 0, "minor": 3}
    layers, tiles = count_rows(layer_counts(scene)), [vars(tile) for tile in scene.tiles]
    return write_blocks(Parts(header, layers, tiles, [], [], options.page_bits), blocks)


def write_blocks(parts: Parts, blocks: Iterable[Block]) -> bytes:
    """The file of these blocks in place of those of `parts`: all else about them follows; no rule is checked.

    Args:
        parts: of them header, layers' counts, tiles and the size of pages count.
        blocks: of layers that there are; at most one TILE block a layer and tile. `stream_bytes` of one are its
            sub-streams' lengths; `flags` None are those of R-5.4-5.
    """
    chosen = sorted(blocks, key=lambda block: (block.layer, block.kind, block.tile or 0))
    parts.blocks = [block.payload for block in chosen]
    parts.entries = [
        {
            "kind": block.kind,
            "flags": int(required_flags(block.kind) or 0) if block.flags is None else block.flags,
            "layer": block.layer,
            "tile": NO_TILE if block.tile is None else block.tile,
            "count": block.count,
            "streams": block.stream_bytes.items(),
        }
        for block in chosen
    ]
    parts.settle()
    return parts.seal()

"""Validation: sound files pass, and damage is reported, at its place, all of it in one run.

That each rule is reported is a claim of `tests.conformance.test_vectors`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import reduce
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from conformance.scenes.made import build, static_plans
from conformance.surgery.files import blocks_of, change_block, rebuilt, stream_bytes, tile_parts, without
from conformance.surgery.parts import flip_bits
from fuzz.testing.scenes import random_scene
from scarfmt.blocks.layer import pack_layer
from scarfmt.blocks.tables import pack_tables
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import write_scene
from scarfmt.container.file import Block, Container, Entry, write_container
from scarfmt.container.schema import BlockKind, Profile, Stream
from scarfmt.container.source import BytesSource
from scarfmt.container.substreams import pack_substreams
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.limits import Limits
from scarfmt.tools.validate import Validation, validate
from tests.samples.container_samples import edit, get

EXPLICIT, ANCHOR = (write_scene(random_scene(1, profile)) for profile in (Profile.EXPLICIT, Profile.ANCHOR))


def check(data: bytes, **options: Any) -> Validation:
    return validate(BytesSource(data), **options)


def refusals(result: Validation) -> list[str]:
    return [finding.refusal for finding in result.findings]


def with_blocks(data: bytes, change: Callable[[Block], Block | None], extra: tuple[Block, ...] = ()) -> bytes:
    """The file with each block passed through `change` (None drops it), all checksums of the container right."""
    blocks = [block for block in map(change, blocks_of(data)) if block is not None]
    return rebuilt(data, [*blocks, *extra])


@settings(max_examples=25)
@given(st.data())
def test_any_cut_is_found_and_tells_the_whole_layers(data: st.DataObject) -> None:
    size = data.draw(st.integers(0, len(EXPLICIT) - 1))
    result = check(EXPLICIT[:size])
    whole = Container(BytesSource(EXPLICIT)).header.layers
    header = Container(BytesSource(EXPLICIT)).header.header_length
    assert refusals(result)[0] in ("truncated-file", "truncated-header")
    whole_layers = sum(layer.end_offset <= size for layer in whole) if size >= header else 0
    assert result.layers_readable == result.layers_available == whole_layers


def tiles_of(data: bytes) -> list[Entry]:
    return [entry for entry in Container(BytesSource(data)).entries if entry.kind == BlockKind.TILE]


def test_all_damaged_blocks_are_told_not_only_the_first() -> None:
    entries = tiles_of(EXPLICIT)[:3]
    result = check(reduce(flip_bits, [entry.offset + 20 for entry in entries], EXPLICIT))
    assert [(f.refusal, f.offset) for f in result.findings] == [("crc-mismatch", e.offset) for e in entries]


@pytest.mark.parametrize("layer", [1, 2, 3])
def test_layers_are_readable_up_to_the_first_that_a_damaged_block_belongs_to(layer: int) -> None:
    """A layer that has arrived is not readable if one of its blocks is damaged."""
    places = [entry.offset + 20 for entry in tiles_of(EXPLICIT) if entry.layer >= layer]
    result = check(reduce(flip_bits, places, EXPLICIT))
    assert (result.layers_declared, result.layers_available, result.layers_readable) == (3, 3, layer - 1)


@pytest.mark.parametrize("damage", ["a word too many", "a sub-stream too many"])
@pytest.mark.parametrize("layer", [1, 2, 3])
def test_a_layer_whose_symbols_do_not_decode_is_not_readable(layer: int, damage: str) -> None:
    """All checksums hold: only decoding shows it, and those before it still decode."""
    blocks = blocks_of(EXPLICIT)
    row = next(i for i, b in enumerate(blocks) if (b.kind, b.layer) == (BlockKind.TILE, layer))
    streams = tile_parts(blocks[row].payload)
    if damage == "a word too many":
        streams[max(streams)] += bytes(4)
    else:
        streams[Stream.MASKS] = bytes(4)
    payload = pack_substreams(streams)
    blocks[row] = replace(blocks[row], payload=payload, stream_bytes=stream_bytes(payload))
    result = check(rebuilt(EXPLICIT, blocks))
    assert not result.valid
    assert result.layers_readable == layer - 1


def test_a_damaged_tile_leaves_the_others_checked() -> None:
    assert check(flip_bits(EXPLICIT, tiles_of(EXPLICIT)[0].offset)).tiles_decoded == 2


def test_layers_limits_what_is_looked_at() -> None:
    damaged = flip_bits(EXPLICIT, -2)
    assert check(damaged, layers=2).valid
    assert check(damaged, layers=2).layers_checked == 2
    assert not check(damaged, layers=3).valid


def test_bytes_after_the_file_do_not_hide_other_damage() -> None:
    assert refusals(check(flip_bits(EXPLICIT, -2) + b"more")) == ["trailing-bytes", "crc-mismatch"]


def test_stream_bytes_of_a_summary_are_compared_with_the_sub_streams() -> None:
    sizes = {kind: get(EXPLICIT, "LAYER_SUMMARY", 1, "stream_bytes", kind) for kind in Stream}
    other = next(kind for kind, size in sizes.items() if kind > Stream.POSITIONS and size >= 4)
    wrong = edit(EXPLICIT, "LAYER_SUMMARY", 1, "stream_bytes", sizes[Stream.POSITIONS] + 4, Stream.POSITIONS)
    wrong = edit(wrong, "LAYER_SUMMARY", 1, "stream_bytes", sizes[other] - 4, other)
    result = check(wrong)
    assert refusals(result) == ["layer-stream-bytes"] * 2
    fields = [finding.field for finding in result.findings]
    assert fields == ["layers[1].stream_bytes[1]", f"layers[1].stream_bytes[{int(other)}]"]


def test_gaussian_counts_are_compared_with_the_masks() -> None:
    count = get(ANCHOR, "LAYER_SUMMARY", 1, "gaussian_count")
    result = check(edit(ANCHOR, "LAYER_SUMMARY", 1, "gaussian_count", count - 1))
    assert refusals(result) == ["layer-counts"]
    assert result.findings[0].field == "layers[1].gaussian_count"


def test_a_missing_model_block_is_told_and_earlier_layers_still_decoded() -> None:
    cut = with_blocks(EXPLICIT, lambda b: None if (b.kind, b.layer) == (BlockKind.LAYER, 2) else b)
    result = check(cut)
    assert refusals(result) == ["missing-block"]
    assert result.tiles_decoded == 3


def test_what_a_decoder_of_all_layers_finds_is_told_before_what_one_of_few_finds() -> None:
    """Layer 1 gives a stage without its network; layer 2 takes the stage back, which the whole is refused for."""
    scene = build(static_plans()["explicit-refined"][1])
    row = replace(scene.model.layers[1], stages=(0, 0))
    data = without(write_scene(scene), BlockKind.DECODER_MLP, 1)
    data = change_block(data, BlockKind.LAYER, 2, lambda _: pack_layer(row, None))
    assert refusals(check(data)) == ["bad-layer-table", "missing-block"]


def test_a_table_nobody_uses_is_a_warning_only() -> None:
    table = SymbolTable(np.array([0, 1]), np.array([1, 1]))

    def with_idle(block: Block) -> Block:
        if (block.kind, block.layer) != (BlockKind.TABLES, 1):
            return block
        reader = SceneReader(BytesSource(EXPLICIT))
        tables = {**reader.models(1).tables[0], TableKey(Stream.COLOUR, 31, 19, 255): table}
        return replace(block, payload=pack_tables(tables), count=len(tables))

    result = check(with_blocks(EXPLICIT, with_idle))
    assert refusals(result) == ["unused-table"]
    assert result.valid


def test_limits_are_the_callers() -> None:
    assert refusals(check(EXPLICIT, limits=Limits(anchors=10))) == ["limit-anchors"]


def test_rules_marked_v_are_reported_after_all_others() -> None:
    """R-12.2-2: counts and sums that a decoder need not compare, found with the first block, are reported last."""
    data = write_scene(random_scene(3, Profile.EXPLICIT))
    container = Container(BytesSource(data))
    counts = [(layer.anchor_count, layer.gaussian_count) for layer in container.header.layers]
    blocks = [
        Block(e.kind, e.layer, payload, e.tile, e.count + (e.kind == BlockKind.LAYER), {}, e.flags)
        for e, payload in container.read_blocks(container.entries)
    ]
    wrong = flip_bits(write_container(container.header.fields, container.tiles, blocks, counts), -2)
    found = refusals(check(wrong))
    assert found[0] == "crc-mismatch"
    assert set(found[1:]) == {"entry-count", "layer-stream-bytes"}

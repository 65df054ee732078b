"""Reading: any layers, tiles and attributes, in any order, are part of the same scene."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from conformance.surgery.files import blocks_of, rebuilt
from conformance.surgery.parts import flip_bits
from fuzz.testing.scenes import random_scene
from fuzz.testing.strategies import quantised_scenes
from scarfmt.coding.reader import ALL_STREAMS, SceneReader
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.file import Block, Container
from scarfmt.container.schema import BlockKind, Profile, Stream
from scarfmt.container.source import BytesSource
from scarfmt.container.substreams import pack_substreams, unpack_table
from scarfmt.errors import Malformed, Truncated
from tests.samples.codec_samples import refuses
from tests.samples.contents import ATTRIBUTES, arrays_of
from tests.samples.equality import same


def opened(data: bytes, *, allow_truncated: bool = False) -> SceneReader:
    return SceneReader(BytesSource(data), allow_truncated=allow_truncated)


@settings(max_examples=20)
@given(quantised_scenes(), st.randoms(use_true_random=False))
def test_the_order_of_tiles_changes_nothing(scene: QuantisedScene, random: object) -> None:
    """Tiles come in the order asked for, also some of them, also twice."""
    order = [*range(len(scene.tiles)), 0]
    random.shuffle(order)  # type: ignore[attr-defined]
    reader = opened(write_scene(scene))
    models = reader.models()
    found = list(reader.tiles(models, order))
    assert [tile for tile, _ in found] == order
    assert all(same(content, scene.contents[tile]) for tile, content in found)
    assert list(reader.tiles(models, [])) == []


def test_the_head_of_a_tile_is_the_tile_itself() -> None:
    """A layer is read into a view of the arrays that hold all layers."""
    whole = random_scene(1, Profile.ANCHOR, anchors=30, tiles=1).contents[0]
    head = whole.head(12)
    assert len(head) == 12
    for part, array in zip(arrays_of(head), arrays_of(whole), strict=True):
        assert part.shape[1:] == array.shape[1:]
        assert part.size == 0 or np.shares_memory(part, array)
    head.classes[:] = 7
    assert (whole.classes == 7).sum() == 12


def test_subsets_read_less() -> None:
    """Fewer bytes for fewer layers, tiles or attributes; nothing but the header and tables to open."""
    data = write_scene(random_scene(8, Profile.ANCHOR, anchors=2000, layers=3, tiles=4))

    def spent(tiles: list[int] | None = None, streams: Set[Stream] = ALL_STREAMS, layers: int | None = None) -> int:
        source = BytesSource(data)
        reader = SceneReader(source)
        list(reader.tiles(reader.models(layers), tiles, streams))
        return source.bytes_read

    whole = spent()
    assert whole <= len(data) + 4096
    assert spent(layers=1) < spent(layers=2) < whole
    assert spent([0]) < spent([0, 1]) < whole
    assert spent(streams=frozenset()) < spent(streams=frozenset({Stream.SCALE})) < whole


@pytest.mark.parametrize("tiles", [[99], [-1], [0, 3]])
def test_tiles_that_do_not_exist_are_invalid_input(tiles: list[int]) -> None:
    """At the call, not when the first tile is taken."""
    reader = opened(write_scene(random_scene(1, tiles=3)))
    models = reader.models()
    refuses("input-tiles", lambda: reader.tiles(models, tiles))


def requests(data: bytes, tiles: list[int] | None = None) -> tuple[int, int]:
    """Requests for models and for tiles."""
    source = BytesSource(data)
    reader = SceneReader(source)
    opening = source.reads
    models = reader.models()
    between = source.reads
    list(reader.tiles(models, tiles))
    return between - opening, source.reads - between


def test_a_layer_is_one_request_for_its_models_and_one_for_its_tiles() -> None:
    """A URL costs a round trip a request: their number must not grow with that of the tiles."""
    data = write_scene(random_scene(8, Profile.ANCHOR, anchors=900, layers=3, tiles=40))
    assert requests(data) == (3, 3)
    # Tiles far from each other are read by themselves: nothing between them is transferred.
    assert requests(data, [1]) == (3, 3)
    assert requests(data, [1, 20, 39]) == (3, 9)


def test_read_ahead_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tiles are read in batches of so many bytes, or one by one where one has more."""
    scene = random_scene(8, Profile.ANCHOR, anchors=900, layers=3, tiles=40)
    data = write_scene(scene)
    entries = [e for e in Container(BytesSource(data)).entries if e.kind == BlockKind.TILE]
    total, largest = sum(e.length for e in entries), 0
    fetch = BytesSource._fetch

    def measured(self: BytesSource, offset: int, length: int) -> bytes:
        nonlocal largest
        if offset >= entries[0].offset:
            largest = max(largest, length)
        return fetch(self, offset, length)

    monkeypatch.setattr(BytesSource, "_fetch", measured)
    for bound in (total // 4, 1):
        monkeypatch.setattr("scarfmt.coding.reader.PREFETCH_BYTES", bound)
        largest = 0
        found = [content for _, content in opened(data).tiles(opened(data).models())]
        assert same(found, scene.contents)
        assert 0 < largest <= max(bound, *(e.length for e in entries))


def test_damage_to_one_tile_does_not_keep_back_those_before_it() -> None:
    """Tiles are read in one request, but verified one by one."""
    data = write_scene(random_scene(8, anchors=900, layers=1, tiles=5))
    last = Container(BytesSource(data)).find(BlockKind.TILE, 1, 4)
    reader = opened(flip_bits(data, last.offset))
    tiles = reader.tiles(reader.models())
    assert [next(tiles)[0] for _ in range(4)] == [0, 1, 2, 3]
    with pytest.raises(Malformed) as caught:
        next(tiles)
    assert (caught.value.refusal, caught.value.offset) == ("crc-mismatch", last.offset)


# ------------------------------------------------------------------------------------------------ broken files


DATA = write_scene(random_scene(1, Profile.EXPLICIT, anchors=60, layers=3))


def test_damage_is_noticed_whether_a_block_is_read_whole_or_in_part() -> None:
    """The block's checksum in one case, the sub-stream's in the other; damage elsewhere does not matter."""
    container = Container(BytesSource(DATA))
    entry = next(e for e in container.entries if e.kind == BlockKind.TILE and e.length > 60)
    reader = opened(flip_bits(DATA, entry.end - 1))
    models = reader.models()
    refuses("crc-mismatch", lambda: list(reader.tiles(models)), kind=Malformed)
    last = max(unpack_table(container.read_block(entry), entry.length))
    refuses("crc-mismatch", lambda: list(reader.tiles(models, streams={last})))
    assert list(reader.tiles(models, streams=ATTRIBUTES - {last}))


def test_a_file_cut_in_its_first_layer_has_nothing_to_decode() -> None:
    """The file can be opened, and reports that no layer is complete."""
    container = Container(BytesSource(DATA))
    data = DATA[: container.header.layers[0].end_offset - 1]
    refuses("truncated-file", lambda: opened(data), kind=Truncated)
    reader = opened(data, allow_truncated=True)
    assert reader.container.available_layers == 0
    refuses("truncated-block", reader.models, kind=Truncated)


@pytest.mark.parametrize("streams", [ALL_STREAMS, frozenset({Stream.SCALE})])
def test_a_sub_stream_that_nothing_reads_is_refused(streams: frozenset[Stream]) -> None:
    """Whatever was asked for: else two readers would disagree about the file."""
    done = False

    def smuggle(block: Block) -> Block:
        nonlocal done
        if block.kind != BlockKind.TILE or done:
            return block
        done = True
        table = unpack_table(block.payload, len(block.payload))
        parts = {kind: block.payload[part.start :][: part.length] for kind, part in table.items()}
        return replace(block, payload=pack_substreams({**parts, Stream.MASKS: b"data"}))

    reader = opened(rebuilt(DATA, [smuggle(block) for block in blocks_of(DATA)]))
    with pytest.raises(Malformed, match="MASKS") as caught:
        list(reader.tiles(reader.models(), streams=streams))
    assert caught.value.refusal == "bad-substream-table"

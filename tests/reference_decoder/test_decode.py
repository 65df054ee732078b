"""Decoding: partial decodes are parts of the whole, bit by bit, and read only what they need."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzz.testing.scenes import random_scene
from fuzz.testing.strategies import quantised_scenes
from reference_decoder.decode import DecodeRequest, decode, decode_scene, iter_tiles
from reference_decoder.decoded import Decoded
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container import paged
from scarfmt.container.directory import Entry
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockKind, Profile, Stream
from scarfmt.container.source import BytesSource
from scarfmt.counters import Counters
from scarfmt.errors import InvalidInput, LimitExceeded
from scarfmt.limits import Limits
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.streams import ATTRIBUTES
from scarfmt.tools.validate import validate
from tests.samples.codec_samples import refuses
from tests.samples.paged_samples import Recorded, in_pages


def assert_equal(a: Decoded, b: Decoded) -> None:
    """Check that every array has the same bits."""
    pairs = [(a.tiles, b.tiles), (a.classes, b.classes), (a.positions, b.positions), (a.indices, b.indices)]
    pairs += [(a.slots, b.slots), *((a.values[stream], b.values[stream]) for stream in a.values)]
    assert a.values.keys() == b.values.keys()
    for x, y in pairs:
        assert (x is None) == (y is None)
        if x is not None and y is not None:
            assert (x.dtype, x.shape, x.tobytes()) == (y.dtype, y.shape, y.tobytes())


@settings(deadline=None, max_examples=12)
@given(quantised_scenes(), st.integers(2, 4))
def test_threads_and_streaming_change_nothing(scene: QuantisedScene, threads: int) -> None:
    data = write_scene(scene)
    whole = decode(data)
    assert_equal(decode(data, threads=threads), whole)
    parts = list(iter_tiles(data, threads=threads))
    assert all(len(part) for part in parts)
    assert [int(part.tiles[0]) for part in parts] == np.unique(whole.tiles).tolist()
    for part in parts:
        assert_equal(part, whole.take(whole.tiles == part.tiles[0]))


@settings(deadline=None, max_examples=12)
@given(quantised_scenes())
def test_tiles_come_in_the_order_asked_for(scene: QuantisedScene) -> None:
    data = write_scene(scene)
    whole = decode(data)
    wanted = list(range(len(scene.tiles)))[::-1]
    for tiles in (wanted, wanted[:1]):
        order = np.concatenate([np.flatnonzero(whole.tiles == tile) for tile in tiles])
        assert_equal(decode(data, tiles=tiles), whole.take(order))


@settings(deadline=None, max_examples=20)
@given(quantised_scenes(), st.lists(st.floats(-2, 5), min_size=6, max_size=6))
def test_box_is_the_anchors_of_the_whole_inside_it(scene: QuantisedScene, numbers: list[float]) -> None:
    data = write_scene(scene)
    whole = decode(data)
    assert whole.positions is not None
    low, high = np.minimum(numbers[:3], numbers[3:]), np.maximum(numbers[:3], numbers[3:])
    inside = ((whole.positions >= low) & (whole.positions <= high)).all(axis=1)
    assert_equal(decode(data, box=(low, high)), whole.take(inside))


def test_box_round_one_anchor_finds_it_also_at_the_edge_of_its_tile() -> None:
    """Tile boxes must hold their anchors whatever the residuals and shifts: a degenerate box is the hardest."""
    for seed in range(5):
        data = write_scene(random_scene(seed, anchors=60))
        whole = decode(data)
        assert whole.positions is not None
        for point in whole.positions[::7]:
            found = decode(data, box=(point, point))
            assert_equal(found, whole.take((whole.positions == point).all(axis=1)))


def test_row_pages_that_are_not_needed_are_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """Row pages of later layers and of other tiles are not read; every page that is needed is read once."""
    # As if the directory were large: small ones are read whole.
    monkeypatch.setattr(paged, "AT_ONCE_BYTES", 0)
    data = in_pages(write_scene(random_scene(3, anchors=900, layers=3, tiles=30)), 2)
    assert_equal(decode(data), decode(in_pages(data, 10)))
    header, rows = Container(BytesSource(data)).header, Container(BytesSource(data)).root.rows
    first = int(rows["offset"][0])
    for request, wanted in (
        (DecodeRequest(layers=1), rows["layer"] == 1),
        (DecodeRequest(tiles=[4, 6]), rows["page"] == 1),
        (DecodeRequest(tiles=[4, 6], layers=2), (rows["page"] == 1) & (rows["layer"] <= 2)),
        (DecodeRequest(), rows["layer"] > 0),
    ):
        source = Recorded(data)
        decode(source, request)
        assert source.ranges[0][0] == 0
        # The read of the longest header goes beyond that of this file.
        parts = [min(start + size, header.data_offset) - max(start, first) for start, size in source.ranges[1:]]
        assert sum(max(0, part) for part in parts) == int(rows["row_bytes"][wanted].sum())


def test_what_may_not_be_held_at_once_is_refused() -> None:
    """Before a tile is decoded; in parts it can be had (R-13.2-3)."""
    data = write_scene(random_scene(3, anchors=900, tiles=4))
    few = Limits(gathered=899)
    for gather in (decode, decode_scene):
        with pytest.raises(LimitExceeded, match="tile by tile") as caught:
            gather(data, limits=few)
        assert caught.value.refusal == "limit-gathered"
        assert len(gather(data, limits=few, tiles=[0])) < 900
        assert len(gather(data, limits=Limits(gathered=900))) == 900
    assert sum(map(len, iter_tiles(data, limits=few))) == 900
    anchors = write_scene(random_scene(3, Profile.ANCHOR, anchors=100))
    slots = 100 * Container(BytesSource(anchors)).header.fields.slots
    assert len(decode(anchors, limits=Limits(gathered_slots=slots))) == 100
    with pytest.raises(LimitExceeded, match="slots"):
        decode(anchors, limits=Limits(gathered_slots=slots - 1))


@pytest.mark.parametrize("profile", list(Profile))
@pytest.mark.parametrize("names", [{"positions", "opacity"}, {"scales"}, set(), {"latents"}])
def test_attributes_are_those_of_the_whole_and_others_are_not_read(profile: Profile, names: set[str]) -> None:
    for seed in range(6):
        data = write_scene(random_scene(seed, profile, anchors=3000))
        source, everything = BytesSource(data), BytesSource(data)
        whole, part = decode(everything), decode(source, attributes=names if len(names) != 1 else next(iter(names)))
        assert source.bytes_read < everything.bytes_read
        assert (part.positions is None) == ("positions" not in names)
        streams = {ATTRIBUTES[name] for name in names} | ({Stream.LATENT} if "latents" in names else set())
        assert set(part.values) == streams & set(whole.values)
        for stream, values in part.values.items():
            assert values.tobytes() == whole.values[stream].tobytes()
        if part.positions is not None and whole.positions is not None:
            assert part.positions.tobytes() == whole.positions.tobytes()
        assert part.classes.tobytes() == whole.classes.tobytes()


def test_scene_of_a_partial_decode_says_what_is_missing() -> None:
    part = decode(write_scene(random_scene(1)), attributes={"positions", "opacity"})
    with pytest.raises(InvalidInput, match="rotations") as caught:
        _ = part.scene
    assert caught.value.refusal == "input-attributes"


@pytest.mark.parametrize(
    ("arguments", "refusal"),
    [
        ({"layers": 0}, "input-layers"),
        ({"layers": 4}, "input-layers"),
        ({"tiles": [3]}, "input-tiles"),
        ({"tiles": [-1]}, "input-tiles"),
        ({"box": (0, 0, 0, 1, 1, 1)}, "input-box"),
        ({"box": ((0, 0, 0), (1, 1))}, "input-box"),
        ({"box": ((0, 0), (1, 1))}, "input-box"),
        ({"box": ((0, 0, 1), (1, 1, 0))}, "input-box"),
        ({"box": ((0, 0, 0), (1, 1, float("nan")))}, "input-box"),
        ({"attributes": ["color"]}, "input-attributes"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(arguments: dict[str, object], refusal: str) -> None:
    refuses(refusal, lambda: decode(write_scene(random_scene(0)), **arguments))


@settings(deadline=None, max_examples=20)
@given(quantised_scenes(), st.integers(1, 3), st.booleans())
def test_a_scene_is_that_of_the_exact_values(scene: QuantisedScene, threads: int, native: bool) -> None:
    """The scene equals that of the exact values: both profiles, whole files, some tiles in any order or repeated, and
    boxes. The counts of work are equal, too."""
    data = write_scene(scene)
    tiles = list(range(len(scene.tiles)))[::-1]
    low, high = np.full(3, -1e3), np.zeros(3)
    requests: list[dict[str, Any]] = [{}, {"layers": 1}, {"tiles": tiles}, {"tiles": tiles + tiles}]
    for fields in [*requests, {"box": (low.tolist(), high.tolist())}]:
        fields = {**fields, "threads": threads, "native": native}
        counted, plain = Counters(), Counters()
        made = decode_scene(data, counters=counted, **fields)
        exact = decode(data, counters=plain, **fields).scene
        assert type(made) is type(exact)
        assert counted == plain
        if isinstance(made, GaussianScene):
            for name, array in made.arrays().items():
                other = getattr(exact, name)
                assert (array.dtype, array.shape) == (other.dtype, other.shape)
                # Activated values have tolerances (SPEC §9.5), the library's are not those of NumPy to the last bit.
                np.testing.assert_allclose(array, other, rtol=1e-5, atol=1e-5)


def test_tiles_of_which_nothing_is_said_cost_next_to_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A directory of a MiB lists 340,000 of them, of 16 layers each: none is opened, by decode or validate."""
    scene = random_scene(3, anchors=60, tiles=40, layers=2)
    data = write_scene(scene)
    container = Container(BytesSource(data))
    filled = {entry.tile for entry in container.load().entries if entry.kind == BlockKind.TILE}
    assert 0 < len(filled) < 40
    opened: list[int] = []
    entries = Container.tile_entries

    def tile_entries(self: Container, tile: int, layers: int) -> list[Entry | None]:
        opened.append(tile)
        return entries(self, tile, layers)

    monkeypatch.setattr(Container, "tile_entries", tile_entries)
    assert len(decode(data)) == 60
    assert set(opened) == filled
    opened.clear()
    assert sum(map(len, iter_tiles(data, tiles=sorted({0, 39} - filled)))) == 0
    assert not opened
    result = validate(BytesSource(data))
    assert result.valid
    assert result.tiles_decoded == 40
    assert set(opened) == filled

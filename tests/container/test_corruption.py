"""Damage: every flipped bit and every cut is noticed, and no file makes a reader do anything but refuse or read."""

from __future__ import annotations

import itertools
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import Generator

from conformance.surgery.files import blocks_of, rebuilt
from fuzz.testing.parts import resealed, resealed_tile
from fuzz.testing.scenes import random_scene
from reference_decoder.decode import decode
from scarfmt.blocks.layer import pack_layer
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.coding.checks_of_models import OUTPUTS_PER_SLOT
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import TileContent, first_values
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.bytefields import compress, decompress
from scarfmt.container.file import Block, Container, HeaderFields, Tile, write_container
from scarfmt.container.schema import BlockKind, Profile, Stream, header_length
from scarfmt.container.source import BytesSource
from scarfmt.errors import InvalidInput, LimitExceeded, Malformed, ScarError, Truncated, Unsupported
from scarfmt.limits import FORMAT_LIMITS
from scarfmt.scene.codebooks import Codebooks
from scarfmt.scene.model import Channel, ContextRule, DecodedContext, LayerRow, SceneModel
from scarfmt.tools.truncate import truncate
from tests.samples.contents import read_everything, same_content


def tiny_scene(profile: Profile) -> QuantisedScene:
    """Two anchors with a block of every kind the profile has, in as few bytes as that takes."""
    anchor = profile == Profile.ANCHOR
    scales = 6 if anchor else 3
    channels = [Channel(Stream.SCALE, (0.5,) * scales, (ContextRule(False),) * scales)]
    if anchor:
        channels.append(Channel(Stream.OFFSETS, (0.1,) * 3, (ContextRule(False),) * 3))
    row = LayerRow((1,), ((1,) * len(channels),))
    model = SceneModel(profile, 2 if anchor else 1, tuple(channels), (row,))
    content = TileContent.empty(model, 2)
    content.codes[:] = 3, 9
    content.values[0][:, 0] = 4, -7
    content.indices[:, 0] = 1, 0
    if anchor:
        content.slot_layers[:] = [[1, 0], [1, 1]]
        content.values[1][:, :, 0] = [[2, 0], [-1, 5]]
    content.first = first_values(model, content)
    fields = HeaderFields(profile, 0, model.slots, 4, (0.0, 0.0, 0.0), 1.0, 2)
    books = Codebooks(np.array([[0], [1]]), np.zeros((0, 1), np.int64))
    decoder = _net(1, 1 if anchor else 3)
    nets = tuple(_net(4, 1, outputs * model.slots) for outputs in OUTPUTS_PER_SLOT) if anchor else ()
    return QuantisedScene(fields, model, (Tile(1, 0, 0),), (content,), books, decoder, nets, {"a": 1})


def _net(*widths: int) -> QuantisedMlp:
    pairs = itertools.pairwise(widths)
    return QuantisedMlp(tuple(Linear.quantised(np.ones((rows, columns)), np.zeros(rows)) for columns, rows in pairs))


SMALL = {profile: write_scene(tiny_scene(profile)) for profile in Profile}
LARGER = [write_scene(random_scene(seed, p, anchors=150, layers=3, tiles=2)) for seed in range(4) for p in Profile]
MIB = 1 << 20


# ------------------------------------------------------------------------------------------------ accidental damage


@pytest.mark.parametrize("profile", Profile)
def test_every_flipped_bit_is_noticed(profile: Profile) -> None:
    """All bits of a small file, one at a time, when everything is read."""
    data = SMALL[profile]
    read_everything(data)
    unnoticed = []
    for bit in range(8 * len(data)):
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        try:
            read_everything(bytes(flipped))
        except ScarError:
            continue
        unnoticed.append(bit)
    assert unnoticed == []


@pytest.mark.parametrize("profile", Profile)
def test_every_cut_is_noticed_and_what_arrived_is_readable(profile: Profile) -> None:
    """Any prefix: refused as truncated, or on request read as the whole layers in it, exactly."""
    data = write_scene(random_scene(6, profile, anchors=20, layers=3, tiles=2))
    whole = SceneReader(BytesSource(data))
    ends = [layer.end_offset for layer in whole.header.layers]
    contents = {k: [c for _, c in whole.tiles(whole.models(k))] for k in (1, 2, 3)}
    decoded = {*range(header_length(3), len(data), 41), *(end + by for end in ends for by in (-1, 0, 1))}
    for size in range(len(data)):
        prefix = data[:size]
        with pytest.raises(Truncated):
            SceneReader(BytesSource(prefix))
        if size < whole.header.data_offset:
            with pytest.raises(Truncated):
                SceneReader(BytesSource(prefix), allow_truncated=True)
            continue
        reader = SceneReader(BytesSource(prefix), allow_truncated=True)
        assert reader.layers == sum(end <= size for end in ends)
        if size in decoded and reader.layers:
            found = [content for _, content in reader.tiles(reader.models())]
            assert all(map(same_content, found, contents[reader.layers]))


@pytest.mark.parametrize("profile", Profile)
def test_bytes_after_the_file_are_noticed(profile: Profile) -> None:
    """A file glued to another, or padded, is not taken for the first."""
    for tail in (b"\0", SMALL[profile]):
        with pytest.raises(Malformed) as caught:
            read_everything(SMALL[profile] + tail)
        assert caught.value.refusal == "trailing-bytes"


# ------------------------------------------------------------------------------------------------ files made on purpose


def test_resealing_a_sound_file_changes_nothing() -> None:
    """The helper that forges checksums computes the real ones."""
    for data in LARGER:
        assert resealed(data) == data
        assert rebuilt(data, blocks_of(data))[header_length(3) :][12 * 2 :] == data[header_length(3) :][12 * 2 :]


def mutated(data: bytes, rng: Generator) -> bytes:
    """Some bytes set to random or special values; sometimes a piece repeated, moved or lost."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        place = int(rng.integers(len(out)))
        width = int(rng.choice([1, 1, 1, 2, 4, 8]))
        value = [bytes(width), b"\xff" * width, b"\x80" * width, b"\x01" + bytes(width - 1), rng.bytes(width)]
        out[place : place + width] = value[int(rng.integers(5))]
    if rng.random() < 0.1:
        a, b = sorted(int(n) for n in rng.integers(0, len(out), 2))
        out[a:b] = bytes(out[a : a + (b - a) // 2]) if rng.random() < 0.5 else b""
    return bytes(out) or b"\0"


def survives(make: Callable[[], bytes]) -> str:
    """Read a forged file completely; the refusal id, or ``""`` when it is readable."""
    data = make()
    try:
        read_everything(data)
    except (Malformed, Unsupported, LimitExceeded) as error:
        return error.refusal
    return ""


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 2**32 - 1), st.sampled_from(LARGER))
def test_forged_bytes_with_right_checksums_are_read_or_refused(seed: int, data: bytes) -> None:
    """Anywhere in the file, front included: only ever our errors."""
    forged = resealed(mutated(data, np.random.default_rng(seed)))
    survives(lambda: forged)
    try:
        truncate(BytesSource(forged), 1)
    except ScarError:
        return


def _forged_payload(block: Block, rng: Generator) -> bytes:
    """A payload changed under its compression and checksums."""
    if block.kind in (BlockKind.TABLES, BlockKind.DECODER_MLP, BlockKind.SCENE_MLP):
        return compress(mutated(decompress(block.payload, MIB, "x"), rng))
    if block.kind == BlockKind.TILE:
        return resealed_tile(mutated(block.payload, rng))
    return mutated(block.payload, rng)


def forged_file(data: bytes, rng: Generator) -> bytes:
    """A file with one or a few blocks changed, repeated in place of others, or left out."""
    blocks = blocks_of(data)
    for _ in range(int(rng.integers(1, 3))):
        row = int(rng.integers(len(blocks)))
        block = blocks[row]
        alike = [other for other in blocks if other.kind == block.kind]
        how = rng.random()
        if how < 0.75:
            blocks[row] = replace(block, payload=_forged_payload(block, rng), stream_bytes={})
        elif how < 0.9:
            other = alike[int(rng.integers(len(alike)))]
            blocks[row] = replace(block, payload=other.payload, stream_bytes={})
        elif block.kind != BlockKind.TILE and len(blocks) > 1:
            del blocks[row]
    return rebuilt(data, blocks)


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 2**32 - 1), st.sampled_from(LARGER))
def test_forged_blocks_in_a_sound_container_are_read_or_refused(seed: int, data: bytes) -> None:
    """Inside compressed payloads and sub-streams too: only ever our errors."""
    survives(lambda: forged_file(data, np.random.default_rng(seed)))


def test_forged_blocks_reach_the_codecs() -> None:
    """The property above is about the codecs' own refusals, not about checksums."""
    seen = {survives(partial(forged_file, LARGER[seed % 8], np.random.default_rng(seed))) for seed in range(150)}
    assert {"", "rans-seal", "missing-table", "bad-varint", "payload-short", "bad-substream-table"} <= seen
    assert "crc-mismatch" not in seen
    assert "directory-crc-mismatch" not in seen


def test_forged_files_take_no_more_memory_than_sound_ones() -> None:
    """Random changes to the blocks of a file of a few KiB do not make it ask for more than a few MiB."""
    worst = 0
    for seed in range(40):
        data = forged_file(LARGER[seed % 8], np.random.default_rng(1000 + seed))
        tracemalloc.start()
        survives(partial(bytes, data))
        worst = max(worst, tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert worst < 16 * MIB


def test_a_forged_anchor_count_is_bounded_by_the_file() -> None:
    """Declared anchors cost memory only in proportion to the bytes that pay for them."""
    data = LARGER[0]
    blocks = [replace(b, count=65000) if b.kind == BlockKind.TILE and b.layer == 1 else b for b in blocks_of(data)]
    container = Container.open(BytesSource(data))
    assert sum(block.kind == BlockKind.TILE and block.layer == 1 for block in blocks) > 0
    counts = [(layer.anchor_count, layer.gaussian_count) for layer in container.header.layers]
    with pytest.raises(InvalidInput, match="anchor"):
        write_container(container.header.fields, container.tiles, blocks, counts)
    assert container.header.anchor_count == 150


def amplifying_file(profile: Profile, anchors: int, slots: int = 1) -> bytes:
    """Equal anchors cost next to nothing: a file of about 2 KiB for any number of them."""
    anchor = profile == Profile.ANCHOR
    scales = 6 if anchor else 3
    rules = (ContextRule(False),)
    channels = [Channel(Stream.SCALE, (0.5,) * scales, rules * scales)]
    channels.append(Channel(Stream.LATENT, (0.5,) * 64, rules * 64))
    if anchor:
        channels.append(Channel(Stream.OFFSETS, (0.1,) * 3, rules * 3))
    row = LayerRow((0,), ((1,) * len(channels),))
    model = SceneModel(profile, slots, tuple(channels), (row,))
    contents = []
    for first in range(0, anchors, 65536):
        contents.append(TileContent.empty(model, min(65536, anchors - first)))
        contents[-1].slot_layers[:] = 1
    decoder = _net(64, 1 if anchor else 3)
    nets = tuple(_net(4, 1, outputs * slots) for outputs in OUTPUTS_PER_SLOT) if anchor else ()
    fields = HeaderFields(profile, 0, slots, 4, (0.0, 0.0, 0.0), 1.0, anchors)
    tiles = tuple(Tile(4, 0, prefix) for prefix in range(len(contents)))
    return write_scene(QuantisedScene(fields, model, tiles, tuple(contents), None, decoder, nets))


def test_a_small_file_asks_for_little_memory() -> None:
    """8,000 anchors of 32 slots in 2 KiB: what a file may ask for beside its bytes, and no more."""
    data = amplifying_file(Profile.ANCHOR, 8000, 32)
    assert len(data) < 4096
    tracemalloc.start()
    decode(data)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 64 * MIB


@pytest.mark.parametrize(("profile", "anchors", "slots"), [(Profile.EXPLICIT, 80000, 1), (Profile.ANCHOR, 18000, 32)])
def test_a_small_file_that_asks_for_more_is_refused(profile: Profile, anchors: int, slots: int) -> None:
    """From its header alone; anchors count, and so do slots."""
    data = amplifying_file(profile, anchors, slots)
    assert len(data) < 4096
    with pytest.raises(LimitExceeded) as caught:
        decode(data)
    assert caught.value.refusal == "limit-expansion"
    assert len(decode(data, limits=FORMAT_LIMITS)) == anchors


def test_wide_channels_are_refused_before_a_tile_is_read() -> None:
    """Components multiply memory: their number is checked with the models."""
    data = SMALL[Profile.ANCHOR]
    wide = Channel(Stream.OFFSETS, (0.1,) * 64, (ContextRule(False),) * 64)
    scale = Channel(Stream.SCALE, (0.5,) * 6, (ContextRule(False),) * 6)
    payload = pack_layer(LayerRow((1,), ((1, 1),)), ((scale, wide), DecodedContext()))
    forged = rebuilt(data, [replace(b, payload=payload) if b.kind == BlockKind.LAYER else b for b in blocks_of(data)])
    with pytest.raises(Malformed) as caught:
        SceneReader(BytesSource(forged)).models()
    assert caught.value.refusal == "bad-channel"

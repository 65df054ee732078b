"""Damage: every flipped bit is noticed, and a small file asks for little."""

from __future__ import annotations

import itertools
import tracemalloc

import numpy as np
import pytest
from scarfmt_conformance.archive import read

from reference_decoder.decode import decode
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.coding.checks_of_models import OUTPUTS_PER_SLOT
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.file import HeaderFields, Tile
from scarfmt.container.schema import Profile, Stream
from scarfmt.errors import ScarError
from scarfmt.scene.model import Channel, LayerRow, SceneModel
from tests.samples.contents import read_everything


def _net(*widths: int) -> QuantisedMlp:
    pairs = itertools.pairwise(widths)
    return QuantisedMlp(tuple(Linear.quantise(np.ones((rows, columns)), np.zeros(rows)) for columns, rows in pairs))


MIB = 1 << 20


@pytest.mark.parametrize("name", ["worked", "edge/anchors-dull"])
def test_every_flipped_bit_is_noticed(name: str) -> None:
    """Bits of every byte of a small file of each profile, one at a time, when everything is read."""
    data = read(name)
    read_everything(data)
    unnoticed = []
    for bit in range(0, 8 * len(data), 3):
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        try:
            read_everything(bytes(flipped))
        except ScarError:
            continue
        unnoticed.append(bit)
    assert unnoticed == []


def amplifying_file(anchors: int, slots: int) -> bytes:
    """Equal anchors cost next to nothing: a file of about 2 KiB for any number of them."""
    steps = {Stream.SCALE: (0.5,) * 6, Stream.LATENT: (0.5,) * 64, Stream.OFFSETS: (0.1,) * 3}
    channels = tuple(Channel(stream, step) for stream, step in steps.items())
    model = SceneModel(Profile.ANCHOR, slots, channels, (LayerRow((0,), ((1,) * len(channels),)),))
    content = TileContent.empty(model, anchors)
    content.slot_layers[:] = 1
    nets = tuple(_net(4, 1, outputs * slots) for outputs in OUTPUTS_PER_SLOT)
    fields = HeaderFields(Profile.ANCHOR, 0, slots, 4, (0.0, 0.0, 0.0), 1.0, anchors)
    return write_scene(QuantisedScene(fields, model, (Tile(4, 0, 0),), (content,), None, _net(64, 1), nets))


def test_a_small_file_asks_for_little_memory() -> None:
    """8,000 anchors of 32 slots in 2 KiB: what a file may ask for beside its bytes, and no more."""
    data = amplifying_file(8000, 32)
    assert len(data) < 4096
    tracemalloc.start()
    decode(data)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 64 * MIB

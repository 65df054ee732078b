"""Fetching in the order of a plan: what is wanted, in few requests; what has come decodes as in the whole file."""

from __future__ import annotations

import numpy as np
import pytest

from reference_decoder.decode import decode
from scarfmt.container.directory import Entry
from scarfmt.container.source import BytesSource, FileSource
from scarfmt.errors import Truncated
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.streaming.client import GAP_BYTES, REQUEST_BYTES, PartialCopy, StreamClient, ranges
from scarfmt.streaming.view import Camera
from scarfmt.tools.annotate import with_streaming
from tests.blocks.test_streaming import told
from tests.streaming.test_plan import TOYS

CAMERA = Camera(np.array([0.0, 0, 6]), np.array([0.0, 0, -1]), np.array([0.0, 1, 0]), 0.8, 400, 300)


def entry(offset: int, length: int) -> Entry:
    return Entry(16, 1, 1, 0, offset, length, 0, 0)


def test_neighbours_are_asked_for_together() -> None:
    """Over gaps that are narrow enough; not beyond the size of a request; in the order of the file."""
    assert ranges([entry(500, 100), entry(0, 100)]) == [(0, 600)]
    assert ranges([entry(0, 100), entry(101 + GAP_BYTES, 100)]) == [(0, 100), (101 + GAP_BYTES, 201 + GAP_BYTES)]
    large = entry(0, REQUEST_BYTES)
    assert ranges([large, entry(REQUEST_BYTES, 1)]) == [(0, REQUEST_BYTES), (REQUEST_BYTES, REQUEST_BYTES + 1)]


def test_a_copy_gives_what_has_come_and_nothing_else() -> None:
    """Pieces that touch are one; a hole is no zero."""
    copy = PartialCopy(100)
    copy.put(10, b"abc")
    copy.put(20, b"xyz")
    copy.put(13, b"defghij")
    assert copy.read(10, 13) == b"abcdefghijxyz"
    for offset, length in ((9, 2), (22, 2), (50, 1)):
        with pytest.raises(Truncated):
            copy.read(offset, length)


def test_what_has_come_is_what_the_whole_file_says() -> None:
    """Tiles of different layers, each as decoded from the whole file to that layer; the rest was never asked for."""
    data = TOYS.read_bytes()
    client = StreamClient(BytesSource(data))
    steps = client.plan(CAMERA)
    done = client.fetch(steps, 25_000)
    assert 0 < done < len(steps)
    assert client.plan(CAMERA) != []
    assert client.transfer.size < 0.9 * len(data)
    assert client.transfer.requests < done
    for layer in range(1, max(client.have) + 1):
        tiles = [tile for tile, have in enumerate(client.have) if have == layer]
        mine, whole = (decode(origin, layers=layer, tiles=tiles).scene for origin in (client.copy, data))
        assert isinstance(mine, GaussianScene)
        assert isinstance(whole, GaussianScene)
        assert np.array_equal(mine.positions, whole.positions)
        assert np.array_equal(mine.sh, whole.sh)


def test_all_steps_bring_all_tiles_once() -> None:
    """In any number of calls; models come before the tiles that need them, and once."""
    with FileSource(TOYS) as source:
        client = StreamClient(source)
        while steps := client.plan(CAMERA):
            client.fetch(steps, 20_000)
        layers = client.index.bytes.shape[1]
        assert client.have == [layers] * len(client.have)
        needed = client.index.bytes.sum() + client.index.model_bytes.sum()
        assert needed <= client.transfer.size <= 1.5 * source.size


def test_what_the_file_tells_is_fetched_with_the_front() -> None:
    """The plan uses the gains that arrived with the front."""
    data = TOYS.read_bytes()
    plain = StreamClient(BytesSource(data))
    assert plain.told is None
    tiles, layers = plain.index.bytes.shape
    client = StreamClient(BytesSource(with_streaming(data, told(tiles, layers))))
    assert client.told is not None
    assert client.transfer.requests == 2
    assert client.plan(CAMERA) != plain.plan(CAMERA)

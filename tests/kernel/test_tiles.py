"""Tiles read whole (SPEC §7): wherever they can be, and equal to the definition's, which test_engine.py compares."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile, Stream
from scarfmt.container.source import BytesSource
from scarfmt.errors import ScarError
from scarfmt.kernel import tiles as tiles_module
from scarfmt.kernel.engine import KernelEngine
from scarfmt.kernel.tiles import KernelTiles
from scarfmt.scene.model import MAX_COMPONENTS
from tests.kernel.samples import SEEDS, library, needs_kernel, same

pytestmark = needs_kernel


@pytest.fixture
def attempts(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """For every tile that was tried, whether it was read whole."""
    found: list[bool] = []
    read = KernelTiles.read

    def watched(self: KernelTiles, *arguments: Any, **named: Any) -> TileContent | None:
        content = read(self, *arguments, **named)
        found.append(content is not None)
        return content

    monkeypatch.setattr(tiles_module.KernelTiles, "read", watched)
    return found


def contents(data: bytes) -> list[TileContent]:
    reader = SceneReader(BytesSource(data), engine=KernelEngine(library()))
    return [content for _, content in reader.tiles(reader.models())]


def test_every_tile_of_gaussians_is_read_whole(attempts: list[bool]) -> None:
    """Else reading them would be slow, and nobody would notice."""
    for seed in range(6):
        contents(write_scene(random_scene(seed, anchors=300, layers=3)))
    assert attempts
    assert all(attempts)


def test_tiles_with_predictors_of_wide_latents_are_read_whole(attempts: list[bool]) -> None:
    """The library's memory for rows is as wide as the widest channel that has predictors."""
    scenes = [neural_scene(seed, latent=MAX_COMPONENTS, network=False) for seed in range(8)]
    predicted = [s for s in scenes if any(p.stream == Stream.LATENT for group in s.predictors.values() for p in group)]
    assert len(predicted) > 2
    for scene in predicted:
        contents(write_scene(scene))
    assert all(attempts)


def test_anchor_models_are_read_layer_by_layer(attempts: list[bool]) -> None:
    """The library does not know their masks and offsets."""
    contents(write_scene(random_scene(3, profile=Profile.ANCHOR)))
    assert not attempts


@settings(deadline=None, max_examples=60)
@given(SEEDS, st.floats(0, 1, exclude_max=True), st.integers(1, 255))
def test_damage_is_found(seed: int, place: float, change: int) -> None:
    """A bit of a block that is not as it was: the tile is not read whole, and read by layers it is refused."""
    data = bytearray(write_scene(random_scene(seed % 5, anchors=200)))
    reader = SceneReader(BytesSource(bytes(data)))
    places = [at for row in range(reader.header.tile_count) for entry in _entries(reader, row) for at in _bytes(entry)]
    data[places[int(place * len(places))]] ^= change
    with pytest.raises(ScarError):
        contents(bytes(data))


def _entries(reader: SceneReader, tile: int) -> list[Any]:
    return [entry for entry in reader.container.tile_entries(tile, reader.layers) if entry is not None]


def _bytes(entry: Any) -> range:
    return range(entry.offset, entry.offset + entry.length)


@settings(deadline=None, max_examples=15)
@given(SEEDS)
def test_first_values_may_be_left_out(seed: int) -> None:
    """First values are left out if the caller does not ask for them; all else stays as it is."""
    data = write_scene(random_scene(seed % 50, anchors=150))
    reader = SceneReader(BytesSource(data), engine=KernelEngine(library()))
    models = reader.models()
    spare = dict(reader.each_tile(models, lambda _, content, __: deepcopy(content)))
    looked_at = {rule.source_channel for channel in models.model.channels for rule in channel.rules}
    for tile, content in reader.tiles(models):
        assert same(spare[tile].values, content.values)
        for index, (some, every) in enumerate(zip(spare[tile].first, content.first, strict=True)):
            assert same(some, every) if index in looked_at or not len(content) else some.shape[1] in (0, every.shape[1])


def test_values_lie_in_planes() -> None:
    """The next step takes the values without a copy."""
    for content in contents(write_scene(random_scene(1, anchors=100))):
        assert all(values.T.flags.c_contiguous for values in content.values if len(content))
        assert all(values.dtype == np.int32 for values in content.values)

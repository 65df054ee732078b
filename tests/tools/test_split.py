"""Parts of a file decode to parts of the scene, whatever they are made of."""

from __future__ import annotations

import io

import numpy as np
import pytest

from fuzz.testing.scenes import random_scene
from reference_decoder.decode import DecodeRequest, decode
from scarfmt.coding.writer import write_scene
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockKind, Profile
from scarfmt.container.source import BytesSource
from scarfmt.tools.split import even_parts, split_to
from scarfmt.tools.validate import validate


@pytest.mark.parametrize("profile", [*Profile])
def test_each_part_is_valid_and_decodes_to_its_tiles(profile: Profile) -> None:
    data = write_scene(random_scene(5, profile, tiles=8))
    tiles = Container(BytesSource(data)).header.tile_count
    parts = [np.arange(0, tiles, 2), np.arange(1, tiles, 2)]
    targets = [io.BytesIO() for _ in parts]
    split_to(BytesSource(data), parts, targets)
    counts = [Container(BytesSource(target.getvalue())).header.fields.source_count for target in targets]
    assert sum(counts) == Container(BytesSource(data)).header.fields.source_count
    for part, target in zip(parts, targets, strict=True):
        made = target.getvalue()
        assert validate(BytesSource(made)).valid
        wanted = decode(BytesSource(data), DecodeRequest(tiles=part.tolist()))
        found = decode(BytesSource(made), DecodeRequest())
        assert len(found.positions) == len(wanted.positions)
        assert np.array_equal(found.positions, wanted.positions)


def test_even_parts_are_of_about_equal_size_and_none_is_empty() -> None:
    container = Container(BytesSource(write_scene(random_scene(5, Profile.EXPLICIT, tiles=8))))
    rows = container.directory[container.directory["kind"] == BlockKind.TILE]
    size = np.bincount(rows["tile"], rows["length"].astype(float))
    for count in range(1, len(size) + 1):
        parts = even_parts(container, count)
        assert np.concatenate(parts).tolist() == list(range(len(size)))
        assert len(parts) == count
        assert min(map(len, parts)) > 0
        assert max(size[part].sum() for part in parts) <= size.sum() / count + size.max()

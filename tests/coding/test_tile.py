"""One tile, layer by layer: what a decoder holds after each, and which streams it needs for that."""

from __future__ import annotations

import numpy as np

from fuzz.testing.scenes import random_scene
from scarfmt.container.schema import Profile
from tests.samples.contents import arrays_of


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

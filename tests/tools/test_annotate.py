"""Annotations put into a file that is finished: the file the writer would have made."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from scarfmt.errors import InvalidInput
from scarfmt.tools.annotate import annotated


@pytest.mark.parametrize("before", [{}, {"title": "old", "year": 1999}])
@pytest.mark.parametrize("after", [{"a": 1}, {"title": "new " * 100, "list": [1, 2.5, None]}])
def test_the_file_is_the_one_the_writer_makes(before: dict[str, Any], after: dict[str, Any]) -> None:
    """Byte for byte, whether there were annotations or not, shorter or longer, with and without networks."""
    for scene in (random_scene(4, Profile.EXPLICIT, anchors=90), random_scene(5, Profile.ANCHOR), neural_scene(3)):
        file = write_scene(replace(scene, metadata=before))
        assert annotated(file, after) == write_scene(replace(scene, metadata=after))


def test_what_no_reader_takes_is_refused() -> None:
    """The writer refuses it, too."""
    with pytest.raises(InvalidInput, match="metadata"):
        annotated(write_scene(random_scene(4, Profile.EXPLICIT, anchors=9)), {"a": float("nan")})

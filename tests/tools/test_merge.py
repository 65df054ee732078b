"""Files of parts of one scene become one; others are refused."""

from __future__ import annotations

import io
from dataclasses import replace
from functools import cache, partial

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from conformance.surgery.parts import flip_bits
from fuzz.testing.scenes import random_scene
from scarfmt.coding.writer import write_scene
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockKind, Profile
from scarfmt.container.source import BytesSource
from scarfmt.errors import Malformed
from scarfmt.tools.merge import merge_to
from scarfmt.tools.split import even_parts, split_to
from scarfmt.tools.truncate import truncate
from tests.blocks.test_streaming import VIEW, random_boxes
from tests.samples.codec_samples import refuses


@cache
def written(profile: Profile, streaming: bool = False) -> bytes:
    scene = replace(random_scene(3, profile, tiles=8), metadata={"title": "whole"})
    return write_scene(replace(scene, streaming=random_boxes(len(scene.tiles)) if streaming else None))


FILES = {profile: written(profile) for profile in Profile}


def split(data: bytes, parts: list[np.ndarray]) -> list[bytes]:
    targets = [io.BytesIO() for _ in parts]
    sizes = split_to(BytesSource(data), parts, targets)
    made = [target.getvalue() for target in targets]
    assert sizes == [len(one) for one in made]
    return made


def merge(files: list[bytes]) -> bytes:
    target = io.BytesIO()
    assert merge_to([BytesSource(data) for data in files], target) == len(target.getvalue())
    return target.getvalue()


def halves(data: bytes) -> list[bytes]:
    return split(data, even_parts(Container(BytesSource(data)), 2))


@settings(max_examples=20)
@given(st.sampled_from([*Profile]), st.booleans(), st.data())
def test_what_was_split_is_merged_to_the_same_bytes(profile: Profile, streaming: bool, data: st.DataObject) -> None:
    """However its tiles are divided, also where parts lie between each other; in any order."""
    whole = written(profile, streaming)
    header = Container(BytesSource(whole)).header
    owners = np.array(data.draw(st.lists(st.integers(0, 3), min_size=header.tile_count, max_size=header.tile_count)))
    parts = split(whole, [np.flatnonzero(owners == owner) for owner in np.unique(owners)])
    assert merge(data.draw(st.permutations(parts))) == whole


def test_other_models_are_refused() -> None:
    """The indices and tables of the other file would mean something else."""
    scene = random_scene(3, Profile.EXPLICIT, tiles=8)
    wider = replace(scene.model.channels[-1], first_width=(0.5,) * scene.model.channels[-1].components)
    other = replace(scene, model=replace(scene.model, channels=(*scene.model.channels[:-1], wider)))
    refuses("input-models-differ", lambda: merge([halves(write_scene(scene))[0], halves(write_scene(other))[1]]))


def test_another_lattice_is_refused() -> None:
    """The same integers would lie elsewhere on another lattice."""
    scene = random_scene(3, Profile.EXPLICIT, tiles=8)
    other = replace(scene, fields=replace(scene.fields, origin=(9.0, 9.0, 9.0)))
    refuses("input-fields-differ", lambda: merge([halves(write_scene(scene))[0], halves(write_scene(other))[1]]))


def test_fewer_layers_are_refused() -> None:
    first, second = halves(FILES[Profile.EXPLICIT])
    refuses("input-models-differ", lambda: merge([first, truncate(BytesSource(second), 1)]))


def test_annotations_that_differ_are_left_out() -> None:
    """Such annotations would be true of only a part of the joined file."""
    scene = random_scene(3, Profile.EXPLICIT, tiles=8)
    told = [{"metadata": said} for said in ({"a": 1}, {"a": 2}, {})]
    views = [{"streaming": random_boxes(8, view)} for view in (VIEW, replace(VIEW, fov=1.0), None)]
    for changes in (told, [*told[1:], {}], views):
        first, second, plain = (halves(write_scene(replace(scene, **change))) for change in changes)
        assert merge([first[0], second[1]]) == merge(plain)


def test_boxes_are_left_out_where_not_all_files_have_them() -> None:
    first, _ = halves(written(Profile.EXPLICIT, streaming=True))
    _, second = halves(FILES[Profile.EXPLICIT])
    assert merge([first, second]) == FILES[Profile.EXPLICIT]


def test_damage_is_not_copied() -> None:
    first, second = halves(FILES[Profile.EXPLICIT])
    models = Container(BytesSource(second)).find(BlockKind.LAYER, 1)
    assert models is not None
    for place in (-2, models.offset):
        refuses("crc-mismatch", partial(merge, [first, flip_bits(second, place)]), kind=Malformed)

"""Declared work: counted before a tile is decoded, far above what real files need, and what bounds made-up ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from fuzz.bombs import many_steps
from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from reference_decoder.decode import decode
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.work import NumberBudget, compute_work
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.schema import Profile
from scarfmt.container.source import BytesSource
from scarfmt.errors import LimitExceeded
from scarfmt.limits import FORMAT_LIMITS, FREE_NUMBERS, FREE_WORK, Limits
from scarfmt.tools.truncate import truncate
from scarfmt.tools.validate import validate
from tests.samples.codec_samples import refuses


def work_of(data: bytes, layers: int | None = None) -> int:
    """Declared work of a file's first layers."""
    reader = SceneReader(BytesSource(data), limits=FORMAT_LIMITS)
    models = reader.models(layers)
    return compute_work(models, *reader.extent(len(models.model.layers), np.arange(reader.header.tile_count)))


@pytest.mark.parametrize("profile", Profile)
@pytest.mark.parametrize("make", [random_scene, neural_scene])
def test_scenes_are_far_below_the_limit(profile: Profile, make: Callable[..., QuantisedScene]) -> None:
    """Random scenes, and with each layer there is more to do."""
    data = write_scene(make(5, profile, anchors=300, layers=3, tiles=3))
    works = [work_of(data, layers) for layers in (1, 2, 3)]
    assert 0 < works[0] < works[1] < works[2] < FREE_WORK / 2


def test_small_files_of_much_work_are_refused() -> None:
    """Not where the caller trusts the file, and cutting layers off needs no decoding."""
    data = many_steps(60_000, 0)
    refuses("limit-work", lambda: decode(data), kind=LimitExceeded)
    assert [f.refusal for f in validate(BytesSource(data)).findings] == ["limit-work"]
    assert SceneReader(BytesSource(data), limits=FORMAT_LIMITS).models()
    assert truncate(BytesSource(data), 1)


def test_the_limit_grows_with_the_file() -> None:
    """The limit is compared with the work exactly."""
    data = write_scene(random_scene(1, anchors=9))
    assert work_of(data) < FREE_WORK
    deep = many_steps(20_000, 0)
    least = -(-(work_of(deep) - FREE_WORK) // len(deep))
    SceneReader(BytesSource(deep), limits=Limits(work_per_byte=least)).models()
    with pytest.raises(LimitExceeded):
        SceneReader(BytesSource(deep), limits=Limits(work_per_byte=least - 1)).models()


def test_adaptive_numbers_are_added_up() -> None:
    """All blocks share one allowance, which grows with the file."""
    budget = NumberBudget(100, Limits())
    assert budget.spend(FREE_NUMBERS)
    assert budget.spend(200)
    assert not budget.spend(1)

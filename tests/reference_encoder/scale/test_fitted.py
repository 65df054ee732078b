"""What is decided on a sample holds for the ranges: size of the file, classes, tiles, and the same each time."""

from __future__ import annotations

import numpy as np

from reference_encoder.encode import encode
from reference_encoder.scale.applied import apply
from reference_encoder.scale.fitted import Sampled
from reference_encoder.scale.sample import joined_samples, sample
from reference_encoder.scale.steps import Sample
from reference_encoder.scale.trained import some_tiles
from reference_encoder.tuning import PREDICTOR_ANCHORS
from scarfmt.limits import MAX_TILE_DEPTH
from tests.reference_encoder.scale.chain import OPTIONS, encoded, example

SIZE = 1200


def samples(every: int) -> list[Sample]:
    """Of each range one Gaussian of so many."""
    chain = encoded(SIZE)
    found = []
    for (part, scene), weights in zip(chain.ranges, chain.measured, strict=True):
        whole = sample(chain.overview, part, scene, weights)
        rows = np.arange(0, len(whole.scene), every)
        taken = type(weights)(*(values[rows] for values in vars(whole.measured).values()))
        found.append(Sample(whole.scene.take(rows), taken, whole.count))
    return found


def test_a_sample_stands_for_all() -> None:
    whole = joined_samples(samples(1))
    assert whole.count == len(whole.scene) == len(example())
    assert joined_samples(samples(4)).count == len(example())


def test_half_of_a_scene_decides_about_what_all_of_it_does() -> None:
    chain = encoded(SIZE)
    all_of_it, half = (Sampled.of(chain.overview, samples(every)).fit(45.0) for every in (1, 2))
    assert abs(all_of_it.classes.count - half.classes.count) <= 1
    last = [fit.model.layers[-1] for fit in (all_of_it, half)]
    assert abs(max(last[0].steps)[0] - max(last[1].steps)[0]) <= 1
    assert half.lambda_ == all_of_it.lambda_


def test_ranges_take_about_as_much_as_the_scene_in_memory() -> None:
    chain = encoded(SIZE)
    size = sum(len(layer.payload) for segment in chain.segments for layer in segment.layers)
    size += sum(len(block.payload) for block in chain.models.blocks)
    assert 0.85 < size / len(encode(example(), OPTIONS)) < 1.15


def test_tiles_stay_in_their_range() -> None:
    chain = encoded(SIZE)
    for (part, _), content in zip(chain.ranges, chain.contents, strict=True):
        for tile in content.tiles:
            free = 3 * (MAX_TILE_DEPTH - tile.depth)
            assert part.first <= tile.prefix << free
            assert (tile.prefix + 1) << free <= part.past


def test_a_range_gives_the_same_each_time_whatever_was_done_before() -> None:
    chain = encoded(SIZE)
    (part, scene), weights = chain.ranges[2], chain.measured[2]
    again = apply(chain.overview, chain.fit, part, scene, weights)
    assert again.tiles == chain.contents[2].tiles
    for one, other in zip(again.contents, chain.contents[2].contents, strict=True):
        assert np.array_equal(one.codes, other.codes)
        assert np.array_equal(one.classes, other.classes)
        assert np.array_equal(one.indices, other.indices)
        assert all(np.array_equal(a, b) for a, b in zip(one.values, other.values, strict=True))


def test_every_gaussian_is_in_the_file_or_told_to_be_left_out() -> None:
    chain = encoded(SIZE)
    for (part, _), content in zip(chain.ranges, chain.contents, strict=True):
        assert sum(map(len, content.contents)) + sum(content.left_out) == part.count


def test_tiles_for_predictors_are_few_and_all_of_a_small_scene() -> None:
    chain = encoded(SIZE)
    part, content = chain.ranges[0][0], chain.contents[0]
    assert len(example()) < PREDICTOR_ANCHORS
    found = some_tiles(chain.overview, part, content)
    assert found.tiles == content.tiles
    assert found.contents == content.contents

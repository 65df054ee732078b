"""What is decided on a sample holds for the ranges: size of the file, classes, tiles, and the same each time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reference_decoder.decode import decode
from reference_encoder.encode import encode
from reference_encoder.scale import sample as module
from reference_encoder.scale.applied import apply
from reference_encoder.scale.fitted import Sampled
from reference_encoder.scale.sample import joined_samples, levels, sample
from reference_encoder.scale.steps import Sample
from reference_encoder.scale.trained import some_tiles
from reference_encoder.tuning import PREDICTOR_ANCHORS
from scarfmt.container.file import Container
from scarfmt.container.registries import Stream
from scarfmt.container.source import BytesSource
from scarfmt.limits import MAX_TILE_DEPTH
from scarfmt.render.metrics import psnr
from scarfmt.render.rasterise import render
from scarfmt.render.upright import AUTO
from scarfmt.render.viewpoints import KINDS, Surroundings, viewpoints
from tests.reference_encoder.scale.chain import OPTIONS, encoded, example, written

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


def test_a_sample_has_its_share_of_every_level_and_some_of_the_highest(monkeypatch: pytest.MonkeyPatch) -> None:
    chain = encoded(SIZE)
    (part, scene), weights = chain.ranges[0], chain.measured[0]
    every = levels(weights, scene.sh_degree)
    monkeypatch.setattr(module, "SAMPLE_ROWS", chain.overview.bounds.count // 7)
    found = sample(chain.overview, part, scene, weights)
    there = levels(found.measured, found.scene.sh_degree)
    assert len(there) == pytest.approx(len(every) / 7, abs=1)
    assert there.max() == every.max()
    for level in np.unique(every):
        assert abs((there >= level).sum() - (every >= level).sum() / 7) <= 1


def test_half_of_a_scene_decides_about_what_all_of_it_does() -> None:
    chain = encoded(SIZE)
    all_of_it, half = (Sampled.of(chain.overview, samples(every)).fit(45.0) for every in (1, 2))
    assert abs(all_of_it.classes.count - half.classes.count) <= 1
    last = [fit.model.layers[-1] for fit in (all_of_it, half)]
    assert abs(max(last[0].steps)[0] - max(last[1].steps)[0]) <= 1
    assert half.lambda_ == all_of_it.lambda_


def bytes_and_psnr(data: bytes) -> tuple[int, float]:
    """The bytes of a file without framing, and its mean PSNR from views of its own; equal pictures count 60 dB."""
    layers = Container.open(BytesSource(data)).header.layers
    framing = sum(layer.stream_bytes[Stream.FRAMING] for layer in layers)
    around, found = Surroundings.of(example(), AUTO), decode(data).scene
    cameras = [camera.sampled(4) for kind in KINDS for camera in viewpoints(around, kind, 8, seed=99)]
    levels = [min(psnr(render(example(), eye), render(found, eye)), 60.0) for eye in cameras]
    return len(data) - framing, float(np.mean(levels))


def test_ranges_take_about_as_much_as_the_scene_in_memory() -> None:
    """At equal PSNR. Borders of ranges make 52 tiles of 18; framing is left out, as no scene in ranges is so small."""
    size, level = bytes_and_psnr(written(encoded(SIZE)))
    in_memory = [bytes_and_psnr(encode(example(), replace(OPTIONS, quality=asked))) for asked in (43.0, 48.0)]
    sizes, levels = zip(*in_memory, strict=True)
    assert levels[0] < level < levels[1]
    assert 0.85 < size / np.exp(np.interp(level, levels, np.log(sizes))) < 1.15


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

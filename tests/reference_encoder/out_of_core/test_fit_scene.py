"""What is decided on a sample holds for the ranges: size of the file, classes, tiles, and the same each time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reference_decoder.decode import decode
from reference_encoder.encode import encode
from reference_encoder.importance.attributes import visible_attributes
from reference_encoder.out_of_core import measure as module
from reference_encoder.out_of_core.fit_scene import fit_sample
from reference_encoder.out_of_core.measure import concatenate_samples, importance_levels, sample_range
from reference_encoder.out_of_core.types import Sample
from reference_encoder.profiles.explicit import view_dependent
from reference_encoder.tuning import REST_SHARE
from scarfmt.container.file import Container
from scarfmt.container.registries import Stream
from scarfmt.container.source import BytesSource
from scarfmt.limits import MAX_TILE_DEPTH
from scarfmt.render.metrics import psnr
from scarfmt.render.rasterise import render
from scarfmt.render.viewpoints import AUTO, KINDS, Surroundings, viewpoints
from tests.reference_encoder.out_of_core.chain import OPTIONS, encoded, example, written

SIZE = 1200


def samples(every: int) -> list[Sample]:
    """Of each range one Gaussian of so many."""
    chain = encoded(SIZE)
    found = []
    for (part, scene), weights in zip(chain.ranges, chain.measured, strict=True):
        sampled, measured = sample_range(chain.overview, part, scene, weights)
        rows = np.arange(0, len(sampled), every)
        found.append((sampled.take(rows), measured.take(rows)))
    return found


def test_a_sample_has_its_share_of_every_level_and_some_of_the_highest(monkeypatch: pytest.MonkeyPatch) -> None:
    chain = encoded(SIZE)
    (part, scene), weights = chain.ranges[0], chain.measured[0]
    every = importance_levels(weights, scene.sh_degree)
    monkeypatch.setattr(module, "SAMPLE_ROWS", chain.overview.bounds.count // 7)
    sampled, measured = sample_range(chain.overview, part, scene, weights)
    there = importance_levels(measured, sampled.sh_degree)
    assert len(there) == pytest.approx(len(every) / 7, abs=1)
    assert there.max() == every.max()
    for level in np.unique(every):
        assert abs((there >= level).sum() - (every >= level).sum() / 7) <= 1


def test_half_of_a_scene_decides_about_what_all_of_it_does() -> None:
    chain = encoded(SIZE)
    taken = (concatenate_samples(samples(every)) for every in (1, 2))
    all_of_it, half = (fit_sample(chain.overview, sample, 45.0) for sample in taken)
    assert abs(all_of_it.classes.count - half.classes.count) <= 1
    last = [fit.model.layers[-1] for fit in (all_of_it, half)]
    assert abs(max(last[0].steps)[0] - max(last[1].steps)[0]) <= 1
    assert half.lambda_ == all_of_it.lambda_


def bytes_and_psnr(data: bytes) -> tuple[int, float]:
    """The bytes of a file without framing, and its mean PSNR from views of its own; equal pictures count 60 dB."""
    layers = Container(BytesSource(data)).header.layers
    framing = sum(layer.stream_bytes[Stream.FRAMING] for layer in layers)
    around, found = Surroundings.of(example(), AUTO), decode(data).scene
    cameras = [camera.sample(4) for kind in KINDS for camera in viewpoints(around, kind, 8, seed=99)]
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
    for (part, _), (whole, _) in zip(chain.ranges, chain.contents, strict=True):
        for tile in whole.tiles:
            free = 3 * (MAX_TILE_DEPTH - tile.depth)
            assert part.first <= tile.prefix << free
            assert (tile.prefix + 1) << free <= part.past


def test_every_gaussian_is_in_the_file_or_told_to_be_left_out() -> None:
    """And those are told that are there without view-dependent colour."""
    chain = encoded(SIZE)
    plain = ~view_dependent(chain.whole)
    assert plain.any()
    for (part, _), (whole, losses) in zip(chain.ranges, chain.contents, strict=True):
        assert sum(map(len, whole.contents)) + losses[:2].sum() == part.count
        assert losses[2] == sum(plain[content.classes].sum() for content in whole.contents)


def test_an_error_of_a_latent_counts_as_that_of_the_colours_it_makes() -> None:
    chain = encoded(SIZE)
    scene, seen = concatenate_samples(samples(9))
    attributes = visible_attributes(scene, seen.pixel)
    assert chain.fit.latent is not None
    latent = chain.fit.latent.of(attributes, seen)
    right, moved = (latent.decoder.apply(latent.values + np.float32(by), np.float64) for by in (0, 1))
    counted = latent.weight * latent.values.shape[1]
    np.testing.assert_allclose(counted, seen.colour * REST_SHARE * ((moved - right) ** 2).sum(axis=1), rtol=1e-2)

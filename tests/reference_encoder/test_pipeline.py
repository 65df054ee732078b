"""The networks of a file: each must pay for its bytes and its time, within a budget; the same seed gives the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from reference_encoder import pipeline
from reference_encoder.decide.assemble import Quantised
from reference_encoder.encode import EncodeOptions, encode
from reference_encoder.networks.candidates import multiply_adds
from reference_encoder.networks.defaults import narrower, shape_for
from reference_encoder.networks.file_costs import index_bytes, within_limits
from reference_encoder.pipeline import Written, best_file
from scarfmt.api import decode
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile, Stream
from scarfmt.container.source import BytesSource
from scarfmt.counters import Counters, Part
from scarfmt.errors import InvalidInput
from scarfmt.limits import Limits
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.tools.inspection import inspect
from scarfmt.tools.models_report import describe_models

OPTIONS = EncodeOptions(effort=2, layers=3, quality=38, archive=True)


@pytest.fixture(scope="module")
def scene() -> GaussianScene:
    """Six thousand Gaussians whose colours and sizes change slowly over a sheet: neighbours predict them well."""
    draw = np.random.default_rng(3)
    count = 6000
    at = draw.uniform(-1, 1, (count, 2))
    height = 0.3 * np.sin(3 * at[:, 0]) * np.cos(2 * at[:, 1])
    sh = np.zeros((count, 4, 3), np.float32)
    sh[:, 0] = np.stack([np.sin(4 * at[:, 0]), np.cos(5 * at[:, 1]), at[:, 0] * at[:, 1]], axis=1)
    sh[:, 1:] = 0.3 * np.sin(6 * at[:, :1, None] + np.arange(3)[None, :, None])
    sizes = -4 + 0.5 * np.sin(5 * at[:, :1]) + draw.normal(0, 0.05, (count, 3))
    return GaussianScene(
        np.column_stack([at[:, 0], height, at[:, 1]]),
        sizes.astype(np.float32),
        np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        np.full(count, 3, np.float32),
        sh,
    )


@pytest.fixture(scope="module")
def plain(scene: GaussianScene) -> Quantised:
    """The scene under static tables."""
    return Quantised(pipeline.quantised(scene, OPTIONS).scene)


@pytest.fixture(scope="module")
def written(plain: Quantised) -> Written:
    """The smallest file of the same symbols."""
    return best_file(plain, OPTIONS)


@pytest.fixture(scope="module")
def data(written: Written) -> bytes:
    """The bytes of the file."""
    return written.data


def test_networks_make_a_file_smaller_where_neighbours_tell_something(plain: Quantised, data: bytes) -> None:
    """Predictors and index network, and the file says so."""
    assert len(data) < 0.97 * len(write_scene(plain.scene))
    report = describe_models(BytesSource(data))
    assert report["predictors"]
    assert report["index_network"] is not None


def test_what_networks_save_and_take_is_measured(plain: Quantised, written: Written) -> None:
    """Bytes saved as files show them, and as many multiply-adds as a decoder counts."""
    told, counters = written.mechanisms, Counters()
    decode(written.data, counters=counters)
    predictors = told["predictors"].values()
    assert sum(one["multiply_adds"] for one in predictors) == counters.multiply_adds[Part.PREDICTORS]
    index = told["index_network"]
    assert counters.multiply_adds[Part.INDEX_NETWORK] <= index["multiply_adds"]
    assert index["multiply_adds"] < 1.5 * counters.multiply_adds[Part.INDEX_NETWORK]
    saved = index["saved"] + sum(one["saved"] for one in predictors)
    assert saved == pytest.approx(len(write_scene(plain.scene)) - len(written.data), rel=0.05)


def test_the_same_seed_gives_the_same_networks(plain: Quantised, data: bytes) -> None:
    """Training included."""
    assert best_file(plain, OPTIONS).data == data


def test_no_file_is_written_that_asks_readers_for_too_much(
    plain: Quantised, data: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SPEC R-13.2-2: networks beyond the limit of work, in whichever layer it is cut, are given up."""
    assert within_limits(data)
    monkeypatch.setattr("scarfmt.coding.work.FREE_WORK", 0)
    assert not within_limits(data, Limits(work_per_byte=1000))
    monkeypatch.setattr("reference_encoder.pipeline.within_limits", lambda data: False)
    assert best_file(plain, OPTIONS).data == write_scene(plain.scene)


@pytest.mark.parametrize(("profile", "seed"), [(Profile.EXPLICIT, 1), (Profile.ANCHOR, 2)])
def test_noise_is_never_made_larger(profile: Profile, seed: int) -> None:
    """If there is nothing to predict, the static file is returned as it is."""
    noise = random_scene(seed, profile, anchors=400)
    assert len(best_file(Quantised(noise), OPTIONS).data) <= len(write_scene(noise))


def test_budget_and_effort_bound_what_is_tried(plain: Quantised, data: bytes) -> None:
    """0 and effort 1: static tables alone. A small budget: a narrower network, or none."""
    static = write_scene(plain.scene)
    assert best_file(plain, replace(OPTIONS, decode_budget=0)).data == static
    assert best_file(plain, replace(OPTIONS, effort=1)).data == static
    whole = describe_models(BytesSource(data))["multiply_adds"]
    bounded = best_file(plain, replace(OPTIONS, decode_budget=whole // 2)).data
    assert describe_models(BytesSource(bounded))["multiply_adds"] <= whole // 2


def test_what_cannot_pay_for_its_time_is_not_even_trained(plain: Quantised, monkeypatch: pytest.MonkeyPatch) -> None:
    """At a bandwidth where bytes are nearly free; with the same symbols an archive has both kinds of networks."""

    def refused(*_: object, **__: object) -> None:
        raise AssertionError("trained in vain")

    monkeypatch.setattr("reference_encoder.networks.candidates.train", refused)
    monkeypatch.setattr("reference_encoder.networks.predict.train", refused)
    fast = replace(OPTIONS, archive=False, mbit=2000)
    assert best_file(plain, fast).data == write_scene(plain.scene)


def test_time_is_what_decides_between(plain: Quantised, data: bytes) -> None:
    """At almost no bandwidth both kinds of networks pay, and hidden units that save little still do not."""
    slow = describe_models(BytesSource(best_file(plain, replace(OPTIONS, archive=False, mbit=0.05)).data))
    assert slow["predictors"]
    assert slow["index_network"] is not None
    assert slow["multiply_adds"] <= describe_models(BytesSource(data))["multiply_adds"]


def test_a_negative_budget_is_refused(scene: GaussianScene) -> None:
    """By name."""
    with pytest.raises(InvalidInput, match="decode_budget"):
        encode(scene, replace(OPTIONS, decode_budget=-1))


def test_index_bytes_count_streams_tables_and_network() -> None:
    """All that indices take: without stages nothing, with a network its block, under static tables theirs."""
    coded = neural_scene(3)
    assert coded.network is not None
    data = write_scene(coded)
    blocks = describe_models(BytesSource(data))["blocks"]
    assert index_bytes(data) >= blocks["entropy_network"] + blocks["hash_grid"]
    rows = tuple(replace(row, neural=False) for row in coded.model.layers)
    plain = replace(coded, model=replace(coded.model, layers=rows), network=None, grid=None)
    static = index_bytes(write_scene(plain))
    streams = sum(_stream_bytes(write_scene(plain)))
    assert static > streams > 0


def _stream_bytes(data: bytes) -> list[int]:
    return [layer["streams"][Stream.INDICES.name.lower()] for layer in inspect(BytesSource(data))["layers"]]


def test_multiply_adds_are_those_of_all_networks() -> None:
    """The number is that of `inspect --models`."""
    scene = neural_scene(5)
    assert multiply_adds(scene) == describe_models(BytesSource(write_scene(scene)))["multiply_adds"]


def test_narrower_shapes_end() -> None:
    """From the widest network to the narrowest, and then none."""
    shape, widths = shape_for(10_000_000, 30), []
    while shape is not None:
        widths.append(shape.hidden)
        shape = narrower(shape)
    assert widths == sorted(set(widths), reverse=True)
    assert widths[-1] >= 6

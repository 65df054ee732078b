"""Codewords chosen again at the index network's prices: never worse by them, always the same, always a valid file."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import torch

from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from reference_encoder import pipeline
from reference_encoder.decide.targets import Targets, joined_classes
from reference_encoder.networks import candidates as neural
from reference_encoder.networks.candidates import Learned, another_round, with_index_network
from reference_encoder.networks.leftovers import leftovers
from reference_encoder.networks.model import Batch
from reference_encoder.networks.rechoose import Chooser, rechosen
from reference_encoder.options import EncodeOptions
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import QuantisedScene, silent, write_scene
from scarfmt.container.schema import Profile, Stream
from scarfmt.container.source import BytesSource
from scarfmt.scene.codebooks import Codebooks
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.model import LayerRow

OPTIONS = EncodeOptions(effort=1)
CASES = [
    (Profile.EXPLICIT, 1, True),
    (Profile.EXPLICIT, 2, False),
    (Profile.EXPLICIT, 3, True),
    (Profile.ANCHOR, 3, False),
    (Profile.ANCHOR, 2, True),
]


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    """Threads only get in each other's way at this size."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def _scene(profile: Profile, stages: int, latent: bool) -> QuantisedScene:
    """The first random scene of that many stages, with or without a LATENT channel."""
    for seed in itertools.count():
        scene = random_scene(seed, profile, anchors=240)
        if scene.model.max_stages == stages and (scene.model.channel_index(Stream.LATENT) is not None) == latent:
            return scene
    raise AssertionError


def _targets(scene: QuantisedScene, lambda_: float = 40.0) -> Targets:
    """Latents near what the scene holds already."""
    draw, count = np.random.default_rng(3), len(joined_classes(scene))
    books = scene.codebooks
    assert books is not None
    exact = Targets(np.zeros((count, books.dimension), np.float32), np.ones(count, np.float32), lambda_)
    noise = draw.normal(0, 15, (count, books.dimension))
    weight = draw.uniform(0.1, 2, count).astype(np.float32)
    return Targets((noise - exact.left(scene)).astype(np.float32), weight, lambda_)


def _learned(scene: QuantisedScene) -> Learned:
    learned = with_index_network(scene, OPTIONS, silent)
    assert learned is not None
    return learned


def _choosers(learned: Learned, targets: Targets) -> Iterator[tuple[int, Chooser]]:
    scene, rests, first = learned.scene, leftovers(learned.scene, targets), 0
    for tile, content in enumerate(scene.contents):
        part = slice(first, first + len(content))
        rows = learned.view.rows(scene, (tile,))
        yield tile, Chooser.of(scene, learned.model, rows, targets.take(part), content.classes, rests)
        first = part.stop


def _assert_comes_back(scene: QuantisedScene) -> None:
    reader = SceneReader(BytesSource(write_scene(scene)))
    for tile, content in reader.tiles(reader.models()):
        expected = scene.contents[tile]
        assert np.array_equal(content.indices, expected.indices)
        assert all(np.array_equal(a, b) for a, b in zip(content.values, expected.values, strict=True))
        assert all(np.array_equal(a, b) for a, b in zip(content.first, expected.first, strict=True))


@pytest.mark.parametrize(("profile", "stages", "latent"), CASES)
def test_a_round_costs_no_anchor_more_and_makes_a_valid_file(profile: Profile, stages: int, latent: bool) -> None:
    """By the network's prices; the trained-on network's file is read back as it was decided."""
    scene = _scene(profile, stages, latent)
    targets, learned = _targets(scene), _learned(scene)
    changed = rechosen(learned.scene, learned.model, learned.view, targets)
    assert any((a.indices != b.indices).any() for a, b in zip(changed.contents, learned.scene.contents, strict=True))
    for tile, chooser in _choosers(learned, targets):
        before, after = (chooser.costs(side.contents[tile].indices) for side in (learned.scene, changed))
        assert (after <= before).all()
    _assert_comes_back(another_round(learned, targets, OPTIONS, silent).scene)


def test_only_indices_and_latent_values_change() -> None:
    """Indices of stages an anchor does not get stay 0; all other channels are as they were."""
    scene = _scene(Profile.EXPLICIT, 3, True)
    learned, index = _learned(scene), scene.model.channel_index(Stream.LATENT)
    changed = rechosen(learned.scene, learned.model, learned.view, _targets(scene))
    for new, old in zip(changed.contents, scene.contents, strict=True):
        received = scene.model.stages(len(scene.model.layers), new.classes)
        assert not new.indices[np.arange(3) >= received[:, None]].any()
        assert np.array_equal(new.codes, old.codes)
        assert np.array_equal(new.classes, old.classes)
        same = [np.array_equal(a, b) for a, b in zip(new.values, old.values, strict=True)]
        assert all(equal for number, equal in enumerate(same) if number != index)


def test_rounds_are_deterministic() -> None:
    """The same scene, targets and seed give the same bytes, and the given network is not changed."""
    scene = _scene(Profile.EXPLICIT, 2, True)
    targets, learned = _targets(scene), _learned(scene)
    weights = [p.detach().clone() for p in learned.model.parameters()]
    first, second = (write_scene(another_round(learned, targets, OPTIONS, silent).scene) for _ in range(2))
    assert first == second
    assert all(torch.equal(a, b) for a, b in zip(weights, learned.model.parameters(), strict=True))


def test_prices_are_those_of_training() -> None:
    """The price of an index is that of the network's loss, if errors are worth nothing."""
    scene = _scene(Profile.ANCHOR, 2, False)
    learned, targets = _learned(scene), _targets(scene, lambda_=1e30)
    for tile, chooser in _choosers(learned, targets):
        rows = learned.view.rows(learned.scene, (tile,))
        batch = Batch(
            torch.from_numpy(rows.inputs).float(),
            torch.from_numpy(rows.before),
            torch.from_numpy(rows.after),
            torch.from_numpy(rows.codes.astype(np.int64)),
        )
        with torch.no_grad():
            bits = float(sum(part.double().sum() for part in learned.model.bits(batch)))
        assert chooser.costs(learned.scene.contents[tile].indices).sum() == pytest.approx(bits, rel=1e-3)


def test_the_cheaper_of_two_like_codewords_is_taken() -> None:
    """Two codewords of a book are nearly one; anchors that use the rare one change to the common one."""
    scene = _scene(Profile.EXPLICIT, 1, False)
    books = scene.codebooks
    assert books is not None
    coarse = books.coarse.copy()
    coarse[1] = coarse[0]
    coarse[1, 0] += 1
    draw = np.random.default_rng(1)
    received = [scene.model.stages(len(scene.model.layers), content.classes) for content in scene.contents]
    picks = [(draw.random((len(n), 1)) < 0.1) * (n > 0)[:, None] for n in received]
    contents = tuple(
        replace(content, indices=pick.astype(np.int16)) for content, pick in zip(scene.contents, picks, strict=True)
    )
    scene = replace(scene, codebooks=Codebooks(coarse, books.residual), contents=contents)
    learned, count = _learned(scene), sum(int((n > 0).sum()) for n in received)
    targets = _targets(scene, lambda_=1.0)
    targets = replace(targets, weight=targets.weight * 1e-3)
    changed = rechosen(learned.scene, learned.model, learned.view, targets)
    assert changed.codebooks is not None
    common = int(np.flatnonzero((changed.codebooks.coarse == coarse[0]).all(axis=1))[0])
    kept = sum(int((c.indices[n > 0, 0] == common).sum()) for c, n in zip(changed.contents, received, strict=True))
    assert kept > 0.99 * count


def _gaussians() -> GaussianScene:
    draw, count = np.random.default_rng(1), 1500
    normal = draw.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    sh = draw.normal(0, 0.05, (count, 9, 3)).astype(np.float32)
    sh[:, 1:4] += (0.2 * normal[:, :, None]).astype(np.float32)
    return GaussianScene(
        normal,
        np.log(draw.uniform(0.01, 0.09, (count, 3))).astype(np.float32),
        draw.normal(size=(count, 4)).astype(np.float32),
        draw.normal(1, 2, count).astype(np.float32),
        sh,
    )


def test_targets_are_those_the_scene_was_decided_by() -> None:
    """Fitting LATENT again to unchanged indices changes nothing: order, steps and weights all agree."""
    made = pipeline.quantised(_gaussians(), EncodeOptions(effort=2, quality=55, layers=3))
    scene, targets = made.scene, made.targets
    index = scene.model.channel_index(Stream.LATENT)
    assert targets is not None
    assert index is not None
    for new, old in zip(targets.refined(scene).contents, scene.contents, strict=True):
        assert np.array_equal(new.values[index], old.values[index])
        assert np.array_equal(new.first[index], old.first[index])
        assert new.values[index].any()


def test_a_round_that_does_not_pay_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Indices at random cost more bytes and more error: the file stays what it is without them."""
    monkeypatch.setitem(neural.EFFORTS, 1, replace(neural.EFFORTS[1], rounds=1))
    scene = _scene(Profile.EXPLICIT, 2, False)
    targets, learned = _targets(scene), _learned(scene)
    rounds: list[Learned] = []

    def worse(before: Learned, *_: object) -> Learned:
        spoilt = replace(targets, latents=-targets.latents)
        rounds.append(another_round(before, spoilt, OPTIONS, silent))
        return rounds[-1]

    monkeypatch.setattr(neural, "another_round", worse)
    assert neural.with_rounds(learned, targets, OPTIONS, silent) is learned
    assert neural.expected_cost(rounds[0], targets) > neural.expected_cost(learned, targets)


def test_a_round_that_pays_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """J of the file, bytes and error together, falls as expected; at effort 1 as it is there are no rounds."""
    scene = _scene(Profile.EXPLICIT, 2, False)
    targets, learned = _targets(scene), _learned(scene)
    data = write_scene(learned.scene)
    assert neural.with_rounds(learned, targets, OPTIONS, silent) is learned
    monkeypatch.setitem(neural.EFFORTS, 1, replace(neural.EFFORTS[1], rounds=1))
    changed = write_scene(another_round(learned, targets, OPTIONS, silent).scene)
    found = neural.with_rounds(learned, targets, OPTIONS, silent)
    assert write_scene(found.scene) == changed
    assert targets.cost(found.scene, len(changed)) < targets.cost(learned.scene, len(data))


def test_scenes_without_indices_have_nothing_to_choose() -> None:
    """No codebooks, no network, no round."""
    scene = neural_scene(3)
    rows = tuple(LayerRow((0,) * row.class_count, row.steps) for row in scene.model.layers)
    bare = replace(scene, model=replace(scene.model, layers=rows), codebooks=None, network=None, grid=None)
    assert with_index_network(bare, OPTIONS, silent) is None

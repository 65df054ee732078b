"""The paper's RVQ-VAE and its conversion to what a file stores."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import torch

from reference_encoder.latent.autoencoder import Autoencoder, AutoencoderOptions, Sampler, VectorCodebook, train
from reference_encoder.latent.learned import best_latents, learned_latent
from reference_encoder.latent.linear import Latent
from reference_encoder.latent.rvq import RvqOptions, RvqResult
from scarfmt.blocks.mlp import pack_networks, unpack_networks
from scarfmt.scene.codebooks import Codebooks

OPTIONS = AutoencoderOptions(
    RvqOptions(32, 3, lambda_=0.0, epochs=0, seed=5), dimensions=6, layer_norm=True, loss="l1", steps=120, batch=256
)


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    """Threads only get in each other's way at this size."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def _vectors(count: int = 1500, width: int = 12, seed: int = 0) -> np.ndarray:
    """Points near a curved two-dimensional surface."""
    draw = np.random.default_rng(seed)
    flat = draw.normal(size=(count, 2))
    curved = np.concatenate([flat, flat**2, np.sin(3 * flat)], axis=1) @ draw.normal(size=(6, width))
    return (curved + draw.normal(size=(count, width)) * 0.05).astype(np.float32)


def _learn(vectors: np.ndarray, options: AutoencoderOptions = OPTIONS, **more: object) -> tuple[Latent, RvqResult]:
    n = len(vectors)
    result = learned_latent(vectors, np.ones(n), np.arange(n) % 2, 0.0, options, **more)  # type: ignore[arg-type]
    assert result is not None
    return result


def _decoded(latent: Latent, chosen: RvqResult, stages: int) -> np.ndarray:
    """The latents that a reader makes of the stored decoder, codewords and indices."""
    books = Codebooks(chosen.coarse, chosen.residual)
    z = books.latents(chosen.indices, np.full(len(chosen.indices), stages))
    return unpack_networks(pack_networks((latent.decoder,)))[0].apply(z, np.float64)


VARIANTS = [
    {},
    {"layer_norm": False},
    {"hidden": 16},
    {"hidden": 16, "layer_norm": False, "loss": "l2"},
    {"estimator": "straight-through"},
]


@pytest.mark.parametrize("change", VARIANTS)
def test_distortion_is_what_a_reader_gets_from_integer_codewords(change: dict[str, object]) -> None:
    x = _vectors()
    latent, chosen = _learn(x, replace(OPTIONS, **change))  # type: ignore[arg-type]
    assert chosen.coarse.dtype == np.int64
    for stages in range(4):
        error = ((_decoded(latent, chosen, stages) - x) ** 2).sum(axis=1)
        np.testing.assert_allclose(chosen.distortion[stages] + latent.lost, error, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("change", VARIANTS)
def test_every_prefix_of_stages_improves(change: dict[str, object]) -> None:
    total = _learn(_vectors(), replace(OPTIONS, **change))[1].distortion.sum(axis=1)  # type: ignore[arg-type]
    assert (np.diff(total) < 0).all()


def test_latent_distance_is_squared_error_for_a_linear_decoder() -> None:
    """The latent channel's plan relies on it."""
    x = _vectors()
    latent, _ = _learn(x)
    step = np.zeros(latent.values.shape[1], np.float32)
    step[:2] = 5, -3
    change = latent.decoder.apply(latent.values + step, np.float64) - latent.decoder.apply(latent.values, np.float64)
    np.testing.assert_allclose((change**2).sum(axis=1), latent.weight * 34.0, rtol=5e-3)


def test_a_metric_decides_what_is_kept_and_the_decoder_still_returns_plain_vectors() -> None:
    """One latent dimension for two independent ones, of which the metric counts the weaker."""
    x = np.random.default_rng(0).normal(size=(600, 2)).astype(np.float32) * np.float32([5, 1])
    options = replace(OPTIONS, dimensions=1, layer_norm=False, loss="l2", steps=300, learning_rate=0.02)
    for metric, kept in ((None, 0), (np.diag([1e-3, 1.0]), 1)):
        latent, _ = _learn(x, options, metric=metric)
        left = ((latent.decoder.apply(latent.values, np.float64) - x) ** 2).mean(axis=0) / x.var(axis=0)
        assert left[kept] < 0.1
        assert left[1 - kept] > 0.8


def test_same_seed_same_result_whatever_torchs_global_generator_says() -> None:
    torch.manual_seed(1)
    one = _learn(_vectors(300))
    torch.manual_seed(2)
    two = _learn(_vectors(300))
    assert pack_networks((one[0].decoder,)) == pack_networks((two[0].decoder,))
    np.testing.assert_array_equal(one[1].indices, two[1].indices)
    np.testing.assert_array_equal(one[1].coarse, two[1].coarse)


def test_training_leaves_torchs_global_generator_alone() -> None:
    torch.manual_seed(1)
    expected = torch.rand(1)
    torch.manual_seed(1)
    train(_vectors(50), np.ones(50), replace(OPTIONS, steps=2))
    torch.testing.assert_close(torch.rand(1), expected)


def test_layer_norm_bounds_the_projector_output() -> None:
    x = _vectors() * 100
    normed = train(x, np.ones(len(x)), replace(OPTIONS, steps=1)).encoded
    free = train(x, np.ones(len(x)), replace(OPTIONS, steps=1, layer_norm=False)).encoded
    assert np.linalg.norm(normed, axis=1).max() < 1.1 * np.sqrt(6)
    assert np.linalg.norm(free, axis=1).max() > 10 * np.sqrt(6)


def test_training_beats_the_untrained_network() -> None:
    x = _vectors()

    def error(steps: int) -> float:
        latent, chosen = _learn(x, replace(OPTIONS, hidden=16, steps=steps))
        return float((chosen.distortion[3] + latent.lost).sum())

    assert error(300) < 0.7 * error(1)


def _trained(vectors: np.ndarray, options: AutoencoderOptions) -> Autoencoder:
    return train(vectors, np.ones(len(vectors)), options)


def _outputs(trained: Autoencoder, z: np.ndarray) -> np.ndarray:
    """The outputs of a linear decoder for (N, d) latents."""
    [(weights, biases)] = trained.decoder
    return np.asarray(z @ weights.T + biases)


def _sums(trained: Autoencoder, stages: int) -> list[np.ndarray]:
    """(N, d) sums of the nearest codewords of 1.. stages."""
    out, total = [], np.zeros_like(trained.encoded)
    for book in [trained.coarse] + [trained.residual] * (stages - 1):
        left = trained.encoded - total
        total = total + book[np.linalg.norm(left[:, None] - book[None], axis=2).argmin(axis=1)]
        out.append(total)
    return out


@pytest.mark.parametrize(("loss", "expected"), [("l1", 0.0), ("l2", 1.0)])
def test_the_loss_is_the_one_asked_for(loss: str, expected: float) -> None:
    """A column that the one latent dimension has no room for becomes its median under L1, its mean under L2."""
    draw = np.random.default_rng(0)
    x = np.stack([10 * draw.normal(size=2000), 5.0 * (np.arange(2000) % 5 == 0)], axis=1).astype(np.float32)
    one_stage = RvqOptions(16, 1, 0.0, 0, 0, 5)
    options = AutoencoderOptions(one_stage, 1, loss=loss, steps=250, batch=256, learning_rate=0.02)
    trained = _trained(x, options)
    assert np.median(_outputs(trained, trained.encoded)[:, 1]) == pytest.approx(expected, abs=0.2)


def test_commitment_pulls_latents_towards_their_codewords() -> None:
    """Share of the latents' variance that one codeword leaves: a quarter without the loss, less the more it weighs."""
    x, left = _vectors(), []
    for weight in (0.0, 0.25, 4.0):
        one = replace(OPTIONS, rvq=replace(OPTIONS.rvq, codewords=16, stages=1), layer_norm=False, commitment=weight)
        trained = _trained(x, one)
        left.append(float(((trained.encoded - _sums(trained, 1)[0]) ** 2).sum() / trained.encoded.var(axis=0).sum()))
    assert left[1] < 0.85 * left[0]
    assert left[2] < 0.95 * left[1]


def test_the_shared_residual_codebook_serves_later_stages_too() -> None:
    """The book learns from all stages: learnt from the second alone, its words are too long for the rests of the
    fifth."""
    trained = _trained(_vectors(), replace(OPTIONS, rvq=replace(OPTIONS.rvq, codewords=8, stages=5), steps=300))
    left = [float(((trained.encoded - total) ** 2).sum()) for total in _sums(trained, 5)]
    assert left[4] < 0.45 * left[1]


def _what_the_decoder_saw(options: AutoencoderOptions) -> list[tuple[torch.Tensor, torch.Tensor]]:
    """The (batch, d) projector output and decoder input of each step; no layer normalisation, a linear decoder."""
    x = _vectors()
    made: list[torch.Tensor] = []
    seen: list[tuple[torch.Tensor, torch.Tensor]] = []

    def watch(module: torch.nn.Module, inputs: tuple[torch.Tensor, ...], output: torch.Tensor) -> None:
        if not isinstance(module, torch.nn.Linear) or not torch.is_grad_enabled():
            return
        if module.in_features == x.shape[1]:
            made.append(output.detach())
        else:
            seen.append((made[-1], inputs[0].detach()))

    hook = torch.nn.modules.module.register_module_forward_hook(watch)
    try:
        _trained(x, options)
    finally:
        hook.remove()
    assert len(seen) == options.steps
    return seen


def _kinds(values: torch.Tensor) -> int:
    """How many different rows, up to rounding."""
    return len(torch.unique((values * 1e4).round(), dim=0))


WATCHED = replace(OPTIONS, rvq=RvqOptions(8, 3, 0.0, 0, 0, 5), layer_norm=False, steps=80)


@pytest.mark.parametrize("estimator", ["rotation", "straight-through"])
def test_the_decoder_sees_first_latents_then_a_mix_then_codewords(estimator: str) -> None:
    """The curriculum of paper §3.6: a quarter of the steps continuous, a quarter of soft injection, then hard."""
    seen = _what_the_decoder_saw(replace(WATCHED, estimator=estimator))
    moved = [float((z - got).norm() / z.norm()) for z, got in seen]
    assert max(moved[:20]) == 0.0
    assert all(0 < share < 1 for share in moved[21:40])
    # The share of the quantised latent grows: means over several steps, as each keeps its own number of stages.
    assert np.mean(moved[21:27]) < 0.5 * np.mean(moved[34:40])
    soft, hard = [_kinds(got) for _, got in seen[21:40]], [_kinds(got) for _, got in seen[41:]]
    assert min(soft) > 200
    assert min(hard) <= 7


def test_stages_are_dropped_at_random_in_training() -> None:
    """Some batches keep one stage, some all: with 7 codewords a book, at most 7 and 49 sums of one and two."""
    hard = [_kinds(got) for _, got in _what_the_decoder_saw(WATCHED)[41:]]
    one, two = sum(kinds <= 7 for kinds in hard), sum(7 < kinds <= 49 for kinds in hard)
    assert min(one, two, len(hard) - one - two) >= 5


def test_the_final_codebook_pass_does_not_hurt() -> None:
    x = _vectors()
    plain = _learn(x)[1].distortion[3].sum()
    passed = _learn(x, replace(OPTIONS, rvq=replace(OPTIONS.rvq, epochs=6)))[1].distortion[3].sum()
    assert passed < 1.05 * plain


def test_progress_rises_to_one() -> None:
    seen: list[float] = []
    _learn(_vectors(200), report=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)


@pytest.mark.parametrize("hidden", [0, 8])
@pytest.mark.parametrize("vectors", [_vectors(1), np.full((20, 12), 3.0, np.float32)], ids=["one", "equal"])
def test_tiny_inputs_come_back(vectors: np.ndarray, hidden: int) -> None:
    latent, chosen = _learn(vectors, replace(OPTIONS, hidden=hidden, steps=8))
    np.testing.assert_allclose(_decoded(latent, chosen, 3), vectors, rtol=1e-3, atol=1e-3)
    assert np.abs(chosen.coarse).max(initial=0) < 32768


def test_two_vectors_are_told_apart() -> None:
    _, chosen = _learn(_vectors(2), replace(OPTIONS, layer_norm=False, steps=150))
    assert chosen.distortion[3].sum() < 0.1 * chosen.distortion[0].sum()


@pytest.mark.parametrize(
    ("vectors", "weight"),
    [(np.zeros((4, 9), np.float32), np.ones(4)), (np.ones((4, 9), np.float32), np.zeros(4))],
)
def test_nothing_visible_is_no_latent(vectors: np.ndarray, weight: np.ndarray) -> None:
    assert learned_latent(vectors, weight, np.zeros(4, np.int64), 0.0, OPTIONS) is None


def test_invisible_vectors_among_visible_ones_cost_nothing() -> None:
    x, weight = _vectors(400), np.ones(400)
    weight[::2] = 0
    result = learned_latent(x, weight, np.zeros(400, np.int64), 0.0, OPTIONS)
    assert result is not None
    assert np.isfinite(result[0].values).all()
    assert (result[1].distortion[:, ::2] == 0).all()


def test_best_latents_undo_a_linear_decoder() -> None:
    draw = np.random.default_rng(0)
    layers = [(draw.normal(size=(8, 3)), draw.normal(size=8))]
    z = draw.normal(size=(50, 3)).astype(np.float32)
    x = (z @ layers[0][0].T + layers[0][1]).astype(np.float32)
    np.testing.assert_allclose(best_latents(layers, x, np.zeros_like(z), 1), z, atol=1e-4)


def test_best_latents_never_make_a_vector_worse() -> None:
    draw = np.random.default_rng(0)
    layers = [(draw.normal(size=(16, 3)), draw.normal(size=16)), (draw.normal(size=(8, 16)), draw.normal(size=8))]
    x, z = draw.normal(size=(200, 8)).astype(np.float32), draw.normal(size=(200, 3)).astype(np.float32)

    def error(latents: np.ndarray) -> np.ndarray:
        hidden = np.maximum(latents @ layers[0][0].T + layers[0][1], 0)
        return np.asarray(((hidden @ layers[1][0].T + layers[1][1] - x) ** 2).sum(axis=1))

    after = error(best_latents(layers, x, z, 4))
    assert (after <= error(z) * (1 + 1e-5)).all()
    assert after.sum() < 0.7 * error(z).sum()


def test_stale_codes_restart_at_vectors_of_the_batch() -> None:
    generator = torch.Generator().manual_seed(0)
    book = VectorCodebook(torch.full((16, 3), 1e3), generator)
    x = torch.randn(500, 3, generator=generator)
    for _ in range(900):
        book.learn(x, book.nearest(x))
    # A code revived in the last round may not serve anything yet.
    assert len(torch.unique(book.nearest(x))) >= 14
    assert float(book.words.norm(dim=1).max()) < 5


def test_kmeans_start_finds_clusters() -> None:
    generator = torch.Generator().manual_seed(0)
    centres = torch.eye(4) * 100
    x = centres.repeat(50, 1) + torch.randn(200, 4, generator=generator)
    book = VectorCodebook.from_kmeans(x, 32, generator)
    assert float((x - book.words[book.nearest(x)]).norm(dim=1).mean()) < 3


def test_vectors_are_drawn_by_weight() -> None:
    sampler = Sampler(np.array([0.0, 1.0, 0.0, 3.0, 0.0]), torch.Generator().manual_seed(0))
    counts = torch.bincount(sampler.draw(4000), minlength=5)
    assert counts[[0, 2, 4]].sum() == 0
    assert 0.7 < float(counts[3]) / 4000 < 0.8

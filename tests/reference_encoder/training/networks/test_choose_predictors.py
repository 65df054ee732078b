"""Choosing predictors: they pay by real coding, never where nothing is predictable, and the same every time."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from reference_encoder.training.networks import choose_predictors as module
from reference_encoder.training.networks.choose_predictors import Sample, choose_predictors, coded_bits, expected_bits
from reference_encoder.training.networks.predictor_training import FloatNet, float_contexts, quantise
from scarfmt.blocks.predictors import pack_predictors
from scarfmt.blocks.tables import fit_table, table_bits
from scarfmt.coding.tile import NeuralModels, TileContent, put_layer
from scarfmt.container.directory import TileFrame
from scarfmt.container.morton import deinterleave
from scarfmt.container.schema import Profile, Stream
from scarfmt.entropy.emitters import SymbolCounter
from scarfmt.neural.predictors import Predictor, check_predictors
from scarfmt.scene.model import Channel, DecodedContext, LayerRow, SceneModel

BITS = 6


def scene(
    seed: int, smooth: bool, stream: Stream = Stream.OPACITY, components: int = 1, depths: tuple[int, ...] = (24, 3)
) -> tuple[SceneModel, list[TileContent]]:
    """Two tiles, one channel, two layers; its values smooth over space, or pure noise."""
    rng = np.random.default_rng(seed)
    channels = tuple(
        Channel(stream, (1.0,) * size) for stream, size in ((Stream.POSITION_RESIDUAL, 3), (stream, components))
    )
    rows = LayerRow((0,), ((0, 1),)), LayerRow((0, 0), ((0, 2), (0, 2)))
    model = SceneModel(Profile.EXPLICIT, 1, channels, rows, DecodedContext(1, depths))
    tiles = []
    for tile in range(2):
        count = 2500
        content = TileContent.empty(model, count)
        codes = rng.integers(0, 8**BITS, count).astype(np.uint64)
        content.classes = np.sort(rng.integers(0, 2, count))
        content.codes = codes[np.lexsort((codes, content.classes))]
        place = deinterleave(content.codes) / 2**BITS
        field = 20 * np.sin(4 * place[:, :1] + tile) if smooth else rng.uniform(-20, 20, (count, 1))
        content.values[1] = np.rint(field + rng.normal(0, 0.3, (count, components))).astype(np.int32)
        tiles.append(content)
    return model, tiles


def bits_of(model: SceneModel, tiles: list[TileContent], chosen: dict[int, tuple[Predictor, ...]]) -> float:
    """Bits of everything coded, with tables and networks."""
    force: dict[tuple[int, int, int], Predictor] = {}
    bits, counter = 0.0, SymbolCounter()
    for layer in range(1, len(model.layers) + 1):
        force.update({predictor.key: predictor for predictor in chosen.get(layer, ())})
        for content in tiles:
            put_layer(model, layer, TileFrame(BITS), content, lambda _: counter, NeuralModels(force))
    for alphabet, counts in counter.histograms().values():
        table = fit_table(alphabet, counts)
        bits += table.cost_of_counts(alphabet, counts) + table_bits(table)
    return bits + sum(8 * len(pack_predictors(group)) for group in chosen.values())


@pytest.mark.parametrize("stream", [Stream.OPACITY, Stream.LATENT])
def test_predictors_pay_where_neighbours_are_alike(stream: Stream) -> None:
    """A smooth field is coded in far fewer bits, and the choice is one that a reader takes; LATENT like any other."""
    model, tiles = scene(1, True, stream)
    chosen = choose_predictors(model, tiles, [BITS, BITS])
    assert set(chosen) == {1, 2}
    for layer, group in chosen.items():
        check_predictors(model, layer, group)
    assert bits_of(model, tiles, chosen) < 0.9 * bits_of(model, tiles, {})


def test_noise_never_costs_more() -> None:
    """Noise is not predictable: a chosen predictor, if any, is tiny and saves tables."""
    model, tiles = scene(2, smooth=False)
    chosen = choose_predictors(model, tiles, [BITS, BITS])
    assert sum(len(pack_predictors(group)) for group in chosen.values()) < 100
    assert bits_of(model, tiles, chosen) <= bits_of(model, tiles, {})


def test_latents_too_wide_for_predictors_have_none() -> None:
    """No byte can number so many inputs."""
    model, tiles = scene(4, True, Stream.LATENT, components=47, depths=(9, 6, 3, 1))
    assert choose_predictors(model, tiles, [BITS, BITS]) == {}


def test_the_choice_is_always_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """The choice does not depend on torch's threads, on earlier random numbers, or on how many samples fit in
    memory."""
    model, tiles = scene(1, smooth=True)
    found, threads = [], torch.get_num_threads()
    for number, held in ((1, 1), (2, 1 << 28)):
        torch.set_num_threads(number)
        monkeypatch.setattr(module, "PREDICTOR_SAMPLE_BYTES", held)
        torch.manual_seed(number)
        chosen = choose_predictors(model, tiles, [BITS, BITS])
        found.append([pack_predictors(chosen[layer]) for layer in sorted(chosen)])
        assert torch.get_num_threads() == number
    torch.set_num_threads(threads)
    assert found[0] == found[1]


def test_quantised_networks_give_nearly_the_contexts_of_the_exact_one() -> None:
    """8-bit weights move few anchors, and none far."""
    rng = np.random.default_rng(0)
    x = rng.integers(-200, 201, (4000, 24)).astype(np.int16)
    net = FloatNet(
        rng.normal(0, 0.01, (6, 24)),
        rng.normal(0, 1, 6),
        rng.normal(0, 0.002, (2, 24)),
        rng.normal(0, 0.5, (2, 6)),
        rng.normal(0, 1, 2),
    )
    outputs, buckets = net.outputs(x.astype(np.float64)), (8, 4)
    predictor = quantise(net, x, outputs, (Stream.SCALE, 0, 2), buckets)
    predictor.check()
    want, found = float_contexts(outputs, buckets), predictor.contexts(x.astype(np.float32))
    assert np.mean(want == found) > 0.8
    assert np.abs(want // 4 - found // 4).max() <= 1


def test_expected_bits_of_small_samples_are_right_on_average() -> None:
    """The entropy of a small sample's histogram is too low: what is estimated for the whole must not be."""
    rng = np.random.default_rng(2)
    contexts = rng.integers(0, 4, 100_000)
    symbols = rng.binomial(6, 0.2 + 0.15 * contexts).astype(np.int64)
    whole = coded_bits([np.bincount(symbols[contexts == c]) for c in range(4)], len(symbols))
    nothing, group = np.zeros((500, 1), np.int16), np.array([500])
    found = [
        expected_bits(part, Sample(nothing, drawn, group, len(symbols)))
        for part, drawn in zip(contexts.reshape(-1, 500), symbols.reshape(-1, 500), strict=True)
    ]
    assert np.mean(found) == pytest.approx(whole, rel=0.004)

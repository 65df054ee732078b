"""Nanoseconds of the parts of a decoder: the constants of scarfmt/coding/decoder_model.py, measured.

    python -m benchmarks.decoder_costs             flowers, some minutes; prints the constants and where they come from
    python -m benchmarks.decoder_costs --short     the example scene, under a minute: small tiles, so less exact

One scene is written in variants that differ in one thing: more steps, predictors of more units or more contexts,
smaller tiles, an index network. All are decoded in turn. What a unit costs is the difference of processor times over
the difference of counts. Nothing is written: a person puts the numbers where they are declared, with date and machine.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

import scarfmt
from benchmarks.report import add_arguments, table
from benchmarks.scenes import chosen
from reference_encoder.networks.affordable import Bounds
from reference_encoder.networks.candidates import with_neural_layers
from reference_encoder.networks.decode_time import class_counts, index_work, received
from reference_encoder.networks.defaults import shape_for
from reference_encoder.networks.grid import wave_grid
from reference_encoder.networks.predict import RunCounter
from reference_encoder.pipeline import quantised
from reference_encoder.tuning import CONTEXT
from scarfmt.coding.decoder_model import DECODER
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import first_values, put_layer
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.directory import TileFrame, local_bits
from scarfmt.container.schema import Stream
from scarfmt.container.source import BytesSource
from scarfmt.counters import Counters, Part
from scarfmt.engines import best_engine
from scarfmt.formats import load
from scarfmt.formats.clean import clean
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.grid import GridBox
from scarfmt.neural.predictors import Predictor, first_use, input_width
from scarfmt.scene.gaussians import GaussianScene

SCENE, SHORT_SCENE = "flowers", "plush-toys"
QUALITY = 41.0
RUNS, SHORT_RUNS = 7, 3
FINER = (Stream.ROTATION, Stream.COLOUR)
"""Channels that get steps more, of random trits."""
MORE_STEPS = 4
WIDTHS = (0, 14)
"""Hidden units of the predictors compared."""
BUCKETS = (16, 8)
"""Contexts of the predictors that open more tables."""
SHAPES = (60_000, 1_000_000)
"""Indices that the index networks compared would be made for."""
SMALL_TILES = 1024


@dataclass(frozen=True)
class Variant:
    """A file, and how often its decoder does what costs.

    Attributes:
        data: the file.
        counts: by name of a constant, or of what only one variant has.
        seconds: of processor, least of the runs, but for reading the models: tables count as bytes.
    """

    data: bytes
    counts: Mapping[str, float]
    seconds: float = float("inf")

    @classmethod
    def of(cls, scene: QuantisedScene) -> Variant:
        """A scene written, decoded once with counters, and its tables counted as they are opened."""
        data, counters, runs = write_scene(scene, engine=best_engine()), Counters(), RunCounter()
        scarfmt.decode(data, threads=1, counters=counters)
        layers = range(1, len(scene.model.layers) + 1)
        for tile, content in zip(scene.tiles, scene.contents, strict=True):
            frame = TileFrame(local_bits(scene.fields, tile))
            for layer in layers:
                put_layer(scene.model, layer, frame, content, lambda _: runs, scene.neural(layer), best_engine())
        products = counters.multiply_adds
        counts = {
            "symbol": counters.symbols_of(),
            "group": runs.runs.total(),
            "tile_layer": len(scene.tiles) * len(layers),
            "predicted": _predicted(scene),
            "predictor_multiply_add": products[Part.PREDICTORS],
            "index_row": index_work(scene).anchors,
            "index_multiply_add": products[Part.INDEX_NETWORK],
        }
        return cls(data, counts)


def _predicted(scene: QuantisedScene) -> int:
    """Anchors that a step with predictors is found for, over all components of all steps."""
    counts = class_counts(scene.contents)
    steps = {(p.stream, p.step) for group in scene.predictors.values() for p in group}
    indices, channels = ((scene.model.channel_index(stream), step) for stream, step in steps), scene.model.channels
    found = ((index, step) for index, step in indices if index is not None)
    return sum(received(scene.model, index, step, counts) * channels[index].components for index, step in found)


def finer(scene: QuantisedScene) -> QuantisedScene:
    """The scene with `MORE_STEPS` of `FINER` channels more in the last layer, of trits that nothing predicts."""
    draw, model = np.random.default_rng(0), scene.model
    places = [index for index in (model.channel_index(stream) for stream in FINER) if index is not None]
    last = model.layers[-1]
    steps = tuple(tuple(n + MORE_STEPS * (i in places and n > 0) for i, n in enumerate(row)) for row in last.steps)
    model = replace(model, layers=(*model.layers[:-1], replace(last, steps=steps)))
    contents = []
    for content in scene.contents:
        values = list(content.values)
        for index in places:
            there = np.array([row[index] > 0 for row in last.steps])[content.classes, None]
            for _ in range(MORE_STEPS):
                values[index] = 3 * values[index] + draw.integers(-1, 2, values[index].shape, np.int32)
            values[index] *= there
        changed = replace(content, values=values)
        changed.first = first_values(model, changed)
        contents.append(changed)
    return replace(scene, model=model, contents=tuple(contents))


def predicted(scene: QuantisedScene, units: int, buckets: tuple[int, int]) -> QuantisedScene:
    """The scene with a predictor of `units` hidden units for every step, its weights drawn at random."""
    draw, model = np.random.default_rng(0), replace(scene.model, context=CONTEXT)
    found: dict[int, tuple[Predictor, ...]] = {}
    for index in model.attributes:
        channel, width = model.channels[index], input_width(model, index)
        for component in range(channel.components):
            for step in range(1, max(row[index] for row in model.layers[-1].steps) + 1):
                hidden = Linear(draw.integers(-9, 10, (units, width)).astype(np.int32), np.zeros(units, np.int64), 4)
                output = Linear(draw.integers(-9, 10, (2, width + units)).astype(np.int32), np.full(2, 64), 7)
                made = Predictor(channel.stream, component, step, hidden if units else None, output, buckets)
                layer = first_use(model, index, step)
                assert layer is not None
                found[layer] = (*found.get(layer, ()), made)
    sent = {layer: tuple(sorted(group, key=lambda predictor: predictor.key)) for layer, group in found.items()}
    return replace(scene, model=model, predictors=sent)


def indexed(scene: QuantisedScene, indices: int) -> QuantisedScene:
    """The scene with an index network as wide as one for so many indices, not trained."""
    scene, books = with_neural_layers(scene), scene.codebooks
    assert books is not None
    network = Bounds(scene, books, np.inf, np.inf).untrained(shape_for(indices, books.dimension))
    return replace(scene, network=network, grid=wave_grid(GridBox((0, 0, 0), scene.fields.lattice_bits)))


def timed(variants: Mapping[str, Variant], runs: int) -> dict[str, Variant]:
    """The variants with their times, decoded in turn."""
    least = dict.fromkeys(variants, float("inf"))
    for _ in range(runs):
        for name, variant in variants.items():
            began = time.process_time()
            SceneReader(BytesSource(variant.data)).models()
            read = time.process_time()
            scarfmt.decode(variant.data, threads=1)
            least[name] = min(least[name], time.process_time() - read - (read - began))
    return {name: replace(variant, seconds=least[name]) for name, variant in variants.items()}


STEPS = (
    ("symbol", "finer", "static"),
    ("group", "contexts", "units 0"),
    ("tile_layer", "small tiles", "static"),
    ("predictor_multiply_add", "units 14", "units 0"),
    ("predicted", "units 0", "static"),
    ("index_multiply_add", "wide network", "narrow network"),
    ("index_row", "narrow network", "static"),
)
"""(constant, variant with more of it, variant with less), in an order in which each needs those before it."""


def solved(variants: Mapping[str, Variant]) -> dict[str, float]:
    """Nanoseconds of each constant, what is known of the others taken off."""
    found: dict[str, float] = {}
    for name, more, less in STEPS:
        first, second = variants[more], variants[less]
        known = sum(ns * (first.counts[other] - second.counts[other]) for other, ns in found.items())
        difference = first.counts[name] - second.counts[name]
        found[name] = (1e9 * (first.seconds - second.seconds) - known) / difference
    return found


def variants_of(source: GaussianScene, base: scarfmt.EncodeOptions) -> dict[str, Variant]:
    """All variants of a scene."""
    static = quantised(source, base)
    scenes = {
        "static": static.scene,
        "finer": finer(static.scene),
        "small tiles": quantised(source, replace(base, tile_anchors=SMALL_TILES)).scene,
        "units 0": predicted(static.scene, WIDTHS[0], (1, 1)),
        "units 14": predicted(static.scene, WIDTHS[1], (1, 1)),
        "contexts": predicted(static.scene, WIDTHS[0], BUCKETS),
        "narrow network": indexed(static.scene, SHAPES[0]),
        "wide network": indexed(static.scene, SHAPES[1]),
    }
    return {name: Variant.of(scene) for name, scene in scenes.items()}


def main() -> None:
    """Measure, and print the constants beside those that are declared."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser, scenes=False)
    given = parser.parse_args()
    scene = chosen([SHORT_SCENE if given.short else SCENE])[0]
    source, _ = clean(load(scene.path), drop_invalid=True)
    assert isinstance(source, GaussianScene)
    variants = variants_of(source, scene.options(quality=QUALITY, effort=1, corrections=0))
    variants = timed(variants, SHORT_RUNS if given.short else RUNS)
    rows = [[name, f"{v.seconds:.3f}", *(f"{n:,.0f}" for n in v.counts.values())] for name, v in variants.items()]
    print(table(["variant", "seconds", *next(iter(variants.values())).counts], rows))
    found = solved(variants)
    rows = [[name, f"{ns:.4g}", f"{getattr(DECODER, name):.4g}"] for name, ns in found.items()]
    print(table(["constant", "ns measured", "ns declared"], rows))


if __name__ == "__main__":
    main()

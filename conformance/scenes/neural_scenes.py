"""The scenes of the valid vectors of the neural entropy model (SPEC §10)."""

from __future__ import annotations

from dataclasses import replace

from conformance.scenes.made import (
    ANCHOR_CHANNELS,
    COLOURED,
    EVERY_CHANNEL,
    REFINED_ROWS,
    SCALE3,
    SPREAD_TILES,
    WHOLE,
    Plan,
    channel,
)
from conformance.scenes.neural_models import GridPlan, NetworkPlan, PredictorPlan
from scarfmt.container.file import Tile
from scarfmt.container.schema import Profile, Stream
from scarfmt.neural.grid import GridLevel
from scarfmt.scene.model import DecodedContext, LayerRow

_ALL_PLANES = tuple(
    GridLevel(plane, resolution, table_log2, features)
    for plane, resolution, table_log2, features in (
        (0, 2, 5, 3), (0, 40, 6, 2), (1, 5, 6, 1), (2, 300, 7, 2), (3, 3, 4, 8), (4, 30, 5, 1), (5, 60, 4, 1),
        (6, 65535, 6, 1),
    )
)


def _row(neural: bool, *classes: tuple[int, int]) -> LayerRow:
    """A row whose classes have (stages, steps of both channels of COLOURED)."""
    return LayerRow(tuple(s for s, _ in classes), tuple((n, n) for _, n in classes), neural)


_on = PredictorPlan


def neural_plans() -> dict[str, tuple[str, Plan]]:
    """Name -> (what it tests, plan)."""
    return {**_predictor_plans(), **_latent_plans(), **_network_plans()}


def _predictor_plans() -> dict[str, tuple[str, Plan]]:
    refined = (LayerRow((0,), ((1,),)), LayerRow((0, 0), ((3,), (2,))), LayerRow((0, 0), ((20,), (2,))))
    return {
        "predictors": ("predictors with and without hidden units on first and later steps, 4 passes, 2 depths", Plan(
            "predictors", EVERY_CHANNEL, REFINED_ROWS, SPREAD_TILES, (60, 30, 0, 50), degree=2, dimension=5,
            context=DecodedContext(2, (40, 5)), predictors=(
                _on(Stream.SCALE, 0, 1, 4), _on(Stream.SCALE, 2, 1, 0, (5, 3), 4), _on(Stream.SCALE, 1, 2, 3),
                _on(Stream.SCALE, 1, 3, 2, (4, 4)), _on(Stream.SCALE, 2, 4, 2, (4, 4)),
                _on(Stream.ROTATION, 0, 1), _on(Stream.ROTATION, 1, 2, 3), _on(Stream.ROTATION, 2, 3, 5, (2, 7), 0),
                _on(Stream.OPACITY, 0, 1, 64, (16, 16), 15), _on(Stream.OPACITY, 0, 2, 2, (1, 1)),
                _on(Stream.COLOUR, 0, 2, 6, (256, 1)), _on(Stream.COLOUR, 1, 1, 3, (1, 256)),
            ))),
        "predictors-deep": ("8 passes, 4 depths down to single cells, 20 steps of large values, some predicted", Plan(
            "deep", (SCALE3,), refined, WHOLE, (150,), bits=7, spread=300,
            context=DecodedContext(3, (65535, 60, 9, 1)),
            predictors=tuple(_on(Stream.SCALE, n % 3, n, n % 4) for n in (1, 3, 4, 7, 18, 20)))),
        "predictors-crowd": ("640 anchors at 8 lattice points: a target met exactly, counts of nine digits", Plan(
            "crowd", (SCALE3,), (LayerRow((0,), ((2,),)),), WHOLE, (640,), codes=8, bits=5, spread=9,
            context=DecodedContext(1, (65535, 80)), predictors=(
                _on(Stream.SCALE, 0, 1, 5, (5, 5)), _on(Stream.SCALE, 2, 2, 5, (5, 5))))),
        "predictors-wide": ("values beyond the range of fine values, hidden units beyond that of activations", Plan(
            "wide fine", COLOURED, (_row(False, (0, 2)),), WHOLE, (50,), bits=5, spread=30000,
            context=DecodedContext(1, (30, 6)), predictors=(
                _on(Stream.SCALE, 1, 1, 4, (6, 6), loudness=2000), _on(Stream.SCALE, 1, 2, 4, (6, 6)),
                _on(Stream.COLOUR, 0, 1, 4, (6, 6), loudness=2000)))),
        "predictors-alone": ("no depths: contexts from the anchor's own values only; one anchor in a tile, too", Plan(
            "alone", COLOURED, (_row(False, (0, 2)),), (Tile(1, 0, 0), Tile(1, 0, 1)), (40, 1), codes=9,
            context=DecodedContext(1, ()), bits=6, predictors=(
                _on(Stream.SCALE, 0, 2, 3), _on(Stream.SCALE, 1, 1), _on(Stream.COLOUR, 1, 1, 2),
                _on(Stream.COLOUR, 2, 2, 3, wide=True)))),
        "predictors-edge": ("accumulators of predictors that reach 2^24 - 1, no more", Plan(
            "predictors edge", COLOURED, (_row(False, (0, 2)),), WHOLE, (60,), bits=6,
            context=DecodedContext(0, (8,)), predictors=(
                _on(Stream.SCALE, 0, 1, 3, edge=True), _on(Stream.COLOUR, 0, 1),
                _on(Stream.COLOUR, 1, 2, 0, (16, 16), wide=True, edge=True)))),
    }


def _latent_plans() -> dict[str, tuple[str, Plan]]:
    anchors = (
        channel(Stream.POSITION_RESIDUAL, 1 / 3, 3),
        channel(Stream.SCALE, 0.25, 6),
        channel(Stream.LATENT, 3.0, 7),
        channel(Stream.OFFSETS, 0.125, 3),
    )
    neural = replace(REFINED_ROWS[2], neural=True)
    return {
        "latents-predicted": ("predictors of LATENT in two layers; the index network beside them sees none of it", Plan(
            "latents", EVERY_CHANNEL, (*REFINED_ROWS[:2], neural), SPREAD_TILES, (60, 30, 0, 50), degree=2, dimension=5,
            context=DecodedContext(2, (40, 5)), predictors=(
                _on(Stream.SCALE, 1, 2, 3), _on(Stream.LATENT, 0, 1, 4, (16, 4)), _on(Stream.LATENT, 2, 1, 0, (5, 3)),
                _on(Stream.LATENT, 3, 2, 3, (2, 7), 4), _on(Stream.LATENT, 4, 1, 64, (256, 1), 15),
                _on(Stream.LATENT, 4, 2)),
            network=NetworkPlan(latents=2, classes=3))),
        "latents-predicted-anchors": ("anchor profile: predictors of LATENT in three layers, 8 passes, 3 depths", Plan(
            "anchor latents", anchors, (
                LayerRow((0,), ((0, 1, 1, 1),)), LayerRow((0, 1), ((1, 1, 2, 1), (1, 2, 0, 1))),
                LayerRow((1, 2), ((2, 2, 4, 1), (1, 2, 1, 1)))), SPREAD_TILES[:2], (50, 60), profile=Profile.ANCHOR,
            slots=4, dimension=7, bits=11, context=DecodedContext(3, (20, 6, 1)), predictors=(
                _on(Stream.SCALE, 5, 2, 2), *(_on(Stream.LATENT, c, 1, c % 3, (4 + c, 3)) for c in (0, 1, 3, 6)),
                *(_on(Stream.LATENT, c, 2, 2 * c, (3, 2)) for c in range(7)), _on(Stream.LATENT, 5, 4, 0, (16, 16))))),
    }


def _network_plans() -> dict[str, tuple[str, Plan]]:
    plain_rows = (_row(True, (1, 1)), _row(True, (2, 1), (3, 1)))
    deep_rows = (_row(True, (1, 1), (2, 1)), _row(True, (2, 2), (2, 2), (0, 1)), _row(True, (4, 2), (3, 3), (8, 2)))
    return {
        "index-plain": ("8 activation bits, no depths, no attention, one pass", Plan(
            "plain", COLOURED, plain_rows, WHOLE, (60,), degree=1, dimension=4,
            loudness=8, network=NetworkPlan(bits=8, gate=12000))),
        "index-deep": ("attention, two recurrent layers, 12 bits, 4 passes, 8 stages", Plan(
            "deep", COLOURED, deep_rows, SPREAD_TILES, (30, 50, 0, 20), degree=1, dimension=5,
            context=DecodedContext(2, (30, 4)), network=NetworkPlan(
                bits=12, widths=(7, 6, 9), dims=5, layers=2, latents=3, latent_shift=0, loudness=16,
                attention=True, classes=3))),
        "index-attention": ("attention, 4 layers, 8 passes, 3 depths", Plan(
            "attention", COLOURED, deep_rows, WHOLE, (70,), degree=1, dimension=3, bits=9,
            context=DecodedContext(3, (50, 10, 2)), network=NetworkPlan(
                bits=9, widths=(3, 5, 4), dims=2, layers=4, latents=1, own=False, attention=True, classes=0,
                wide=True))),
        "index-grid": ("hash grid levels of every plane, dense and hashed, in a box smaller than the scene", Plan(
            "grid", COLOURED, plain_rows, SPREAD_TILES, (40, 40, 0, 20), degree=1, dimension=4,
            context=DecodedContext(1, (12,)), network=NetworkPlan(),
            grid=GridPlan((4000, 0, 9001), 15, _ALL_PLANES))),
        "index-grid-small": ("a hash grid in a box of 2^4 lattice steps: fractions shift left; no other input", Plan(
            "small grid", COLOURED, (_row(True, (2, 1)),), WHOLE, (40,), degree=1, dimension=4, bits=5,
            network=NetworkPlan(classes=0, own=False, loudness=16),
            grid=GridPlan((0, 3, 1), 4, _ALL_PLANES[:3]))),
        "index-equal": ("all logits equal; a residual codebook of one codeword: nothing is coded", Plan(
            "equal", COLOURED, (_row(True, (2, 1)),), WHOLE, (50,), degree=1, dimension=2, bits=6,
            codewords=(12, 1), context=DecodedContext(0, (6,)),
            network=NetworkPlan(dims=2, logits=(0,) * 12))),
        "index-ladder": ("distances of logits on both sides of every bound of exp2w", Plan(
            "ladder", COLOURED, (_row(True, (2, 1)),), WHOLE, (50,), degree=1, dimension=2, bits=6,
            network=NetworkPlan(dims=2, logits=(0, -1, -31, -32, -33, -400, -510, -511, -512, -513, -600, -100000)))),
        "index-edge": ("every accumulator reaches 2^24 - 1, recurrent ones 2^23 - 1, no more", Plan(
            "edge", COLOURED, (_row(True, (1, 1)), _row(True, (3, 1))), WHOLE, (50,), degree=1, dimension=3, bits=6,
            context=DecodedContext(0, (6,)), network=NetworkPlan(
                bits=11, layers=2, attention=True, edge=True, classes=1))),
        "index-modes": ("entropy modes 0, 1, 0, 1: states run over stages that tables coded; predictors beside", Plan(
            "modes", COLOURED, (
                _row(False, (1, 1)), _row(True, (2, 2)), _row(False, (3, 2)), _row(True, (5, 3), (1, 1))),
            WHOLE, (60,), degree=1, dimension=4, bits=8, context=DecodedContext(1, (20, 3)),
            predictors=(PredictorPlan(Stream.SCALE, 1, 2, 3), PredictorPlan(Stream.COLOUR, 0, 3, 3)),
            network=NetworkPlan(latents=4, latent_shift=0, loudness=8, attention=True, tokens=7))),
        "anchors-neural": ("anchor profile: predictors, index network with attention and hash grid", Plan(
            "anchors neural", ANCHOR_CHANNELS, (
                LayerRow((1,), ((1, 1),), True), LayerRow((3, 1), ((2, 1), (1, 1)), True)), SPREAD_TILES[:2], (50, 40),
            profile=Profile.ANCHOR, slots=5, dimension=4, context=DecodedContext(1, (16, 4)),
            predictors=(PredictorPlan(Stream.SCALE, 0, 1, 3), PredictorPlan(Stream.SCALE, 5, 2, 3)),
            network=NetworkPlan(latents=2, attention=True),
            grid=GridPlan((0, 0, 0), 16, _ALL_PLANES[1:4]))),
    }

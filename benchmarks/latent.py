"""Linear against learned latents at equal bits: the table of docs/decisions/0005-latent.md.

    python -m benchmarks.latent plush-on-bed.ply --frame=-y:125:70
    python -m benchmarks.latent plush-on-bed.npz --cameras cameras.json
    python -m benchmarks.latent --short                        few vectors of the example scene, few steps

It prints its table and writes nothing.
Error is weighted by visibility, counts every anchor and includes what the latent cannot represent; it is given
in dB relative to sending nothing but the mean. Bits are those of ideal static tables per class and stage, plus
codebooks and decoder as stored.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import add_arguments
from benchmarks.scenes import chosen
from reference_encoder.decide.allocate import classify, entropy_bits
from reference_encoder.latent.autoencoder import AutoencoderOptions, train
from reference_encoder.latent.fit import codebook_size
from reference_encoder.latent.learned import choose, stored, whiten
from reference_encoder.latent.linear import Latent, linear_latent
from reference_encoder.latent.rvq import RvqOptions, RvqResult, Vectors, quantise
from reference_encoder.measure.anchor_sensitivity import measure_anchors
from reference_encoder.measure.attributes import from_scene
from reference_encoder.measure.sensitivity import measure
from reference_encoder.measure.survey import GIVEN, Survey, survey
from reference_encoder.measure.weights import weighed
from reference_encoder.options import EncodeOptions
from reference_encoder.tuning import SLOT_ABSENCE
from scarfmt.arrays import F64
from scarfmt.blocks.codebooks import pack_codebooks
from scarfmt.blocks.mlp import pack_networks
from scarfmt.formats import anchor_npz, inria_ply
from scarfmt.formats.source import Source
from scarfmt.render.capture import load_cameras
from scarfmt.render.upright import Upright

STAGES = 4
RATE_FACTORS = (1.0, 8.0, 64.0)


@dataclass(frozen=True)
class Problem:
    """Vectors to code, (N, D), with everything that says how well."""

    vectors: NDArray[np.float32]
    weight: F64
    classes: NDArray[np.int64]
    rate: float
    metric: F64 | None


def explicit_problem(path: Path, frame: str, quality: float) -> Problem:
    """Rest coefficients of a scene, as the encoder of the explicit profile sees them."""
    scene = inria_ply.load(Source(path))
    attributes = from_scene(scene)
    seen = measure(attributes, weighed(scene, survey(scene, EncodeOptions(frame=frame))))
    rate = 10 ** (-quality / 10) / (6.0 * len(scene))
    classes, _ = classify(seen.absence, rate, 40.0, 8)
    kept = np.flatnonzero(classes >= 0)
    return Problem(attributes.rest[kept], seen.colour[kept] * 1.3, classes[kept], rate, None)


def anchor_problem(path: Path, cameras: Path, quality: float) -> Problem:
    """Features of an anchor model, as the encoder of the anchor profile sees them."""
    model = anchor_npz.load(Source(path))
    views = [camera for camera in load_cameras(cameras) if camera.split != "test"][::4]
    seen = measure_anchors(model, Survey({GIVEN: views}, {GIVEN: 1.0}, 1.0, Upright("-y")), 0, lambda _fraction: None)
    rate = 10 ** (-quality / 10) / (3.0 * len(model) * model.slots)
    classes, _ = classify(seen.shape.sum(axis=1) * SLOT_ABSENCE, rate, 60.0, 7)
    kept = np.flatnonzero(classes >= 0)
    return Problem(model.features[kept], seen.feature[kept], classes[kept], rate, seen.metric)


def thinned(problem: Problem, limit: int) -> Problem:
    """At most `limit` of the vectors."""
    kept = np.linspace(0, len(problem.vectors) - 1, min(limit, len(problem.vectors))).astype(np.int64)
    return replace(problem, vectors=problem.vectors[kept], weight=problem.weight[kept], classes=problem.classes[kept])


def curve(problem: Problem, latent: Latent, chosen: RvqResult) -> list[tuple[float, float]]:
    """(bits an anchor, weighted error) after 1..M stages."""
    decoder = 8 * len(pack_networks((latent.decoder,)))
    points, bits = [], float(decoder + 8 * len(pack_codebooks({0: chosen.coarse})))
    for stage in range(chosen.indices.shape[1]):
        if stage == 1:
            bits += 8 * len(pack_codebooks({1: chosen.residual}))
        bits += entropy_bits(chosen.indices[:, stage].astype(np.int64), problem.classes)
        points.append((bits / len(problem.vectors), float((chosen.distortion[stage + 1] + latent.lost).sum())))
    return points


def variants(rvq: RvqOptions, steps: int) -> Iterator[tuple[str, AutoencoderOptions]]:
    """The variants of the table: the paper's choice first, then one change at a time."""
    paper = AutoencoderOptions(replace(rvq, epochs=0), hidden=64, layer_norm=True, loss="l1", steps=steps)
    yield "paper: LayerNorm, rotation, L1, H=64", paper
    yield "straight-through", replace(paper, estimator="straight-through")
    yield "no LayerNorm", replace(paper, layer_norm=False)
    yield "no LayerNorm, L2", replace(paper, layer_norm=False, loss="l2")
    yield "no LayerNorm, L2, H=0", replace(paper, layer_norm=False, loss="l2", hidden=0)
    yield "paper, H=0", replace(paper, hidden=0)
    yield "paper + final codebook pass", replace(paper, rvq=rvq)
    yield "no LayerNorm, L2 + final codebook pass", replace(paper, layer_norm=False, loss="l2", rvq=rvq)
    yield "no LayerNorm, L2, H=0 + final codebook pass", replace(paper, layer_norm=False, loss="l2", hidden=0, rvq=rvq)


Curves = list[list[tuple[float, float]]]


def linear_curves(problem: Problem, rvq: RvqOptions) -> tuple[float, Curves]:
    """Error that no number of bits removes, and one curve for each lambda."""
    tolerance = problem.rate * len(problem.vectors)
    latent = linear_latent(problem.vectors, problem.weight, tolerance, problem.metric)
    assert latent is not None
    return float(latent.lost.sum()), [
        curve(problem, latent, quantise(Vectors(latent.values, latent.weight, problem.classes), options))
        for options in (replace(rvq, lambda_=problem.rate * factor) for factor in RATE_FACTORS)
    ]


def learned_curves(problem: Problem, options: AutoencoderOptions) -> tuple[float, Curves]:
    """The curves of the learned latent, in the form of `linear_curves`; it is trained once."""
    space = whiten(problem.vectors, problem.weight, problem.metric)
    trained = train(space.x, problem.weight, options)
    latent, start = stored(trained, space, problem.weight, options)
    return float(latent.lost.sum()), [
        curve(problem, latent, choose(latent, start, space, problem.weight, problem.classes, rvq))
        for rvq in (replace(options.rvq, lambda_=problem.rate * factor) for factor in RATE_FACTORS)
    ]


def at_bits(curves: Curves, bits: F64) -> F64:
    """Error in log10 at `bits` on the lower envelope of all points, straight between them; NaN outside."""
    best: list[tuple[float, float]] = []
    for cost, error in sorted(point for each in curves for point in each):
        if not best or error < best[-1][1]:
            best.append((cost, error))
    costs, errors = np.array(best).T
    return np.asarray(np.interp(bits, costs, np.log10(errors), left=np.nan, right=np.nan))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, nargs="?", help="default: the example scene of this repository")
    parser.add_argument("--cameras", type=Path, help="for an anchor model")
    parser.add_argument("--frame", default="-y", help="for a scene")
    parser.add_argument("--quality", type=float, default=45.0)
    parser.add_argument("--steps", type=int)
    parser.add_argument("--bits", type=float, nargs="+", default=[5.0, 8.0, 12.0, 16.0])
    parser.add_argument("--limit", type=int, help="maximum number of anchors, drawn evenly")
    parser.add_argument("--seed", type=int, default=0)
    add_arguments(parser, scenes=False)
    arguments = parser.parse_args()
    path = arguments.scene or chosen(["plush-toys"])[0].path
    if path.suffix == ".npz":
        problem = anchor_problem(path, arguments.cameras, arguments.quality)
    else:
        problem = explicit_problem(path, arguments.frame, arguments.quality)
    limit, steps = (1_000, 5) if arguments.short else (20_000, 800)
    steps = steps if arguments.steps is None else arguments.steps
    table(thinned(problem, arguments.limit or limit), steps, np.array(arguments.bits), arguments.seed)


def table(problem: Problem, steps: int, bits: F64, seed: int) -> None:
    """Print the Markdown table."""
    rvq = RvqOptions(codebook_size(len(problem.vectors)), STAGES, problem.rate, epochs=7, seed=seed)
    space = whiten(problem.vectors, problem.weight, problem.metric)
    nothing = float((problem.weight * (space.x.astype(np.float64) ** 2).sum(axis=1)).sum()) * space.scale**2
    print(f"\n{problem.vectors.shape[0]} x {problem.vectors.shape[1]}, {rvq.codewords} codewords, {steps} steps\n")
    print("| latent | s | floor, dB | bits: dB after 1..4 stages |" + "".join(f" dB at {b:g} bits |" for b in bits))
    print("|---|---|---|---|" + "---|" * len(bits), flush=True)

    def row(name: str, seconds: float, floor: float, curves: Curves) -> None:
        stages = ", ".join(f"{b:.1f}: {10 * np.log10(e / nothing):.2f}" for b, e in curves[0])
        equal = 10 * (at_bits(curves, bits) - np.log10(nothing))
        cells = "".join(f" {value:.2f} |" for value in equal)
        print(f"| {name} | {seconds:.0f} | {10 * np.log10(floor / nothing):.1f} | {stages} |{cells}", flush=True)

    began = time.perf_counter()
    linear = linear_curves(problem, rvq)
    row("linear", time.perf_counter() - began, *linear)
    for name, options in variants(rvq, steps):
        began = time.perf_counter()
        learned = learned_curves(problem, options)
        row(name, time.perf_counter() - began, *learned)


if __name__ == "__main__":
    main()

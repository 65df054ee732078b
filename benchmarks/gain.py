"""What integer networks save: the same symbols under static tables, with predictors, with the index network.

    python -m benchmarks.gain                              every scene, about a quarter of an hour
    python -m benchmarks.gain --scenes plush-dog --qualities 47
    python -m benchmarks.gain --report                     only rewrite the table

All model bytes are counted: tables, predictors, network, grid. Codewords are not chosen again, so the decoded scene
is the same in every column. Results are merged into benchmarks/results/gain.json; the table is in docs/benchmarks.md.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any

from benchmarks.report import load_results, machine, replace_section, save_results, table
from benchmarks.scenes import Scene, chosen
from reference_encoder.anchor_profile import encode_anchors
from reference_encoder.clean import clean
from reference_encoder.explicit_profile import encode_explicit
from reference_encoder.importers import load
from reference_encoder.neural import index_bytes, with_index_network, with_predictors
from reference_encoder.options import EncodeOptions
from scarfmt.reader import SceneReader
from scarfmt.scene import AnchorModel
from scarfmt.source import BytesSource
from scarfmt.writer import QuantisedScene, silent, write_scene

NAME = "gain"
QUALITIES = (41.0, 47.0)
DECODE_RUNS = 3


def quantised(scene: Scene, options: EncodeOptions) -> QuantisedScene:
    """What the encoder decides for a scene, before any network."""
    source, _ = clean(load(scene.path), drop_invalid=True)
    if isinstance(source, AnchorModel):
        return encode_anchors(source, options, silent)[0]
    return encode_explicit(source, options, silent)[0]


def decode_seconds(data: bytes) -> float:
    """Seconds to decode a file to exact integers, one thread; the best of some runs."""
    best = float("inf")
    for _ in range(DECODE_RUNS):
        start = time.perf_counter()
        reader = SceneReader(BytesSource(data))
        for _tile in reader.tiles(reader.models()):
            pass
        best = min(best, time.perf_counter() - start)
    return best


def measure(scene: Scene, quality: float) -> dict[str, Any]:
    """Bytes and seconds of the static file and of what networks make of it."""
    options = EncodeOptions(quality=quality, frame=scene.frame, cameras=scene.known_cameras())
    plain = quantised(scene, options)
    static = write_scene(plain)
    began = time.perf_counter()
    predicted = with_predictors(plain, options, silent)
    between = time.perf_counter()
    learned = with_index_network(predicted or plain, options, silent)
    done = time.perf_counter()
    middle = static if predicted is None else write_scene(predicted)
    whole = middle if learned is None else write_scene(learned.scene)
    return {
        "scene": scene.name,
        "quality": quality,
        "anchors": sum(len(content) for content in plain.contents),
        "static_bytes": len(static),
        "predicted_bytes": len(middle),
        "neural_bytes": len(whole),
        "static_index_bytes": index_bytes(static),
        "neural_index_bytes": index_bytes(whole),
        "predictor_seconds": between - began,
        "network_seconds": done - between,
        "decode_seconds": [decode_seconds(data) for data in (static, middle, whole)],
        "machine": machine(),
    }


def gain_table(results: dict[str, Any]) -> str:
    """The table of docs/benchmarks.md."""
    head = ["scene", "quality", "anchors", "static, bytes", "predictors", "and network", "indices, static", "indices"]
    head += ["train, s", "decode, s: static, predictors, network"]
    rows = []
    for r in results.values():
        first, static = r["static_index_bytes"], r["static_bytes"]
        rows.append(
            [
                r["scene"],
                f"{r['quality']:g}",
                f"{r['anchors']:,}",
                f"{static:,}",
                _change(r["predicted_bytes"], static),
                _change(r["neural_bytes"], static),
                f"{first:,}" if first else "none",
                _change(r["neural_index_bytes"], first) if first else "",
                f"{r['predictor_seconds'] + r['network_seconds']:.0f}",
                ", ".join(f"{seconds:.2f}" for seconds in r["decode_seconds"]),
            ]
        )
    machines = sorted({r["machine"] for r in results.values()})
    return table(head, rows) + f"\nTimes on {'; '.join(machines)}; other programs were running.\n"


def _change(now: int, before: int) -> str:
    return f"{100 * (now / before - 1):+.1f} %"


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", metavar="NAME", help="scenes to measure [default: all that are here]")
    parser.add_argument("--qualities", nargs="+", type=float, default=QUALITIES)
    parser.add_argument("--report", action="store_true", help="measure nothing, rewrite the table")
    arguments = parser.parse_args()
    results = load_results(NAME)
    for scene in [] if arguments.report else chosen(arguments.scenes):
        for quality in arguments.qualities:
            print(f"{scene.name}, quality {quality:g}", file=sys.stderr, flush=True)
            results[f"{scene.name} q{quality:g}"] = measure(scene, quality)
            save_results(NAME, results)
    replace_section(NAME, gain_table(results))


if __name__ == "__main__":
    main()

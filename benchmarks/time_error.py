"""Run time against error: decoding and encoding, by layer, effort, precision, entropy coder and machine.

    python -m benchmarks.time_error                        all sections, an hour or more
    python -m benchmarks.time_error --sections ways limit --scenes flowers
    python -m benchmarks.time_error --short --no-write     the example scene at effort 1, printed
    python -m benchmarks.time_error --report               only rewrite tables and plots

Every figure comes from a process of its own; what is compared takes turns. Results are merged into
benchmarks/results/time-error.json; tables and plots are in docs/time-and-error.md.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks import time_error_precision as precision
from benchmarks import time_error_tables as tables
from benchmarks.gain import NEURAL
from benchmarks.report import add_arguments, dated, load_results, replace_section, save_results
from benchmarks.scenes import REPOSITORY, Scene, chosen
from benchmarks.time_error_decoding import measure_entropy, measure_ways
from benchmarks.time_error_files import measure_efforts, measure_layers
from benchmarks.time_error_limit import measure_limit
from benchmarks.time_error_plots import draw

NAME = "time-error"
PAGE = REPOSITORY / "docs" / "time-and-error.md"
QUALITIES = (41.0, 47.0)
LOW, EFFORT, ROUNDS = 41.0, 2, 2
SHORT_SCENES, SHORT_QUALITY, SHORT_QUALITIES = ("plush-toys",), 45.0, (45.0, 47.0)
SLOW_EFFORT_SCENES = ("plush-toys",)
"""Encoded at effort 3, too: elsewhere that takes longer than all the rest."""
Record = dict[str, Any]


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        scenes: measured unless scenes are named.
        measure: (scene, short) -> records by key.
        text: records -> Markdown.
    """

    scenes: tuple[str, ...]
    measure: Callable[[Scene, bool], dict[str, Record]]
    text: Callable[[Sequence[Record]], str]


def _rounds(short: bool) -> int:
    return 1 if short else ROUNDS


def _layers(scene: Scene, short: bool) -> dict[str, Record]:
    found = {}
    for quality in (SHORT_QUALITY,) if short else QUALITIES:
        effort = 1 if short else EFFORT
        found[f"{scene.name} q{quality:g}"] = measure_layers(scene, quality, effort, _rounds(short))
    return found


def _efforts(scene: Scene, short: bool) -> dict[str, Record]:
    if short:
        return {scene.name: measure_efforts(scene, SHORT_QUALITIES, (1,))}
    return {scene.name: measure_efforts(scene, QUALITIES, (1, 2, 3) if scene.name in SLOW_EFFORT_SCENES else (1, 2))}


def _precision(scene: Scene, short: bool) -> dict[str, Record]:
    p, rounds = precision, _rounds(short)
    if short:
        networks = p.measure_networks(scene, 1, rounds, p.SHORT_WEIGHT_BITS, p.SHORT_ACTIVATION_BITS)
        positions = p.measure_positions(scene, SHORT_QUALITY, rounds, p.SHORT_POSITION_BITS)
        steps = p.measure_steps(scene, rounds, SHORT_QUALITIES)
    else:
        networks = p.measure_networks(scene, EFFORT, rounds, p.WEIGHT_BITS, p.ACTIVATION_BITS)
        positions = p.measure_positions(scene, LOW, rounds, p.POSITION_BITS)
        steps = p.measure_steps(scene, rounds, p.STEP_QUALITIES)
    return {scene.name: {"scene": scene.name, "networks": networks, "positions": positions, "steps": steps}}


def _entropy(scene: Scene, short: bool) -> dict[str, Record]:
    if short:
        return {scene.name: measure_entropy(scene, LOW, 1, 1, (NEURAL,))}
    return {scene.name: measure_entropy(scene, LOW, EFFORT, ROUNDS)}


def _ways(scene: Scene, short: bool) -> dict[str, Record]:
    if not short:
        return {scene.name: measure_ways(scene, LOW, EFFORT, ROUNDS)}
    # Importing torch takes as long as all the rest.
    names = [f"numpy, {threads}{kernel}" for threads in ("1 thread", "2 threads") for kernel in ("", ", kernel")]
    return {scene.name: measure_ways(scene, SHORT_QUALITY, 1, 1, names)}


def _limit(scene: Scene, short: bool) -> dict[str, Record]:
    quality, effort = (SHORT_QUALITY, 1) if short else (LOW, EFFORT)
    return {scene.name: measure_limit(scene, quality, effort, _rounds(short))}


SECTIONS = {
    "layers": Section(("plush-toys", "plush-on-bed", "flowers"), _layers, tables.layers_text),
    "efforts": Section(("plush-toys", "plush-on-bed", "flowers"), _efforts, tables.efforts_text),
    "precision": Section(("plush-toys",), _precision, tables.precision_text),
    "entropy": Section(("plush-toys", "plush-on-bed"), _entropy, tables.entropy_text),
    "ways": Section(("plush-on-bed", "flowers"), _ways, tables.ways_text),
    "limit": Section(("plush-on-bed", "flowers"), _limit, tables.limit_text),
}


def texts(results: dict[str, Any]) -> dict[str, str]:
    """Markdown of every section with results."""
    return {name: SECTIONS[name].text(list(results[name].values())) for name in SECTIONS if results.get(name)}


def write(results: dict[str, Any]) -> None:
    """Rewrite the page's tables and plots."""
    for name, text in texts(results).items():
        replace_section(name, dated(text, NAME, section=f"{name}/"), PAGE)
    draw(results, keep=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--sections", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    parser.add_argument("--report", action="store_true", help="measure nothing, rewrite tables and plots")
    arguments = parser.parse_args()
    results = {} if arguments.no_write else load_results(NAME)
    for name in [] if arguments.report else arguments.sections:
        section = SECTIONS[name]
        for scene in chosen(arguments.scenes or (SHORT_SCENES if arguments.short else section.scenes)):
            began = time.perf_counter()
            found = section.measure(scene, arguments.short)
            results.setdefault(name, {}).update(found)
            save_results(NAME, results, not arguments.no_write, [f"{name}/{below}" for below in found])
            print(f"{time.perf_counter() - began:5.0f} s  {name}, {scene.name}", file=sys.stderr, flush=True)
    if arguments.no_write:
        print("\n\n".join(f"## {name}\n\n{text}" for name, text in texts(results).items()))
        draw(results, keep=False)
    else:
        write(results)


if __name__ == "__main__":
    main()

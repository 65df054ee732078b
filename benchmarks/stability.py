"""Numerical stability: exact values that never differ, and the worst case found of every value with a tolerance.

    python -m benchmarks.stability               minutes; rewrites docs/stability.md, its plot and its JSON
    python -m benchmarks.stability --short       a part of it, on the example scene and some conformance vectors

Exits with 1 if exact values differ or a tolerance of SPEC §9.5 is exceeded.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.encoded import encoded, encoded_path
from benchmarks.entropy_edges import measure_edges
from benchmarks.plots import line, new_plot, save_plot
from benchmarks.report import add_arguments, dated, replace_section, save_results
from benchmarks.scenes import REPOSITORY, chosen
from benchmarks.stability_activated import activations, reference_error
from benchmarks.stability_files import (
    BASE,
    Digests,
    Manner,
    decoding,
    digests,
    manners,
    neural_vectors,
    orders,
    vectors,
)
from benchmarks.stability_networks import measure_networks
from benchmarks.stability_processes import decoded_elsewhere, encode_in, encoder_environments, environments
from benchmarks.stability_search import profile, search
from benchmarks.stability_tables import failures, markdown
from benchmarks.stability_values import measure_values
from scarfmt.errors import ScarError

NAME = "stability"
PAGE = REPOSITORY / "docs" / "stability.md"
EXAMPLE, QUALITY = "plush-toys", 41.0
EXPONENTS = range(-56, 124, 8)
_SHORT_PROCESSES = ("BLAS kernels: Prescott", "NumPy: without SIMD beyond its baseline", "torch kernels: default")
_LARGE_TILES, _LARGE_ORDERS = 2, 3

Results = dict[str, Any]


def compare_files(paths: Sequence[Path], ways: Mapping[str, Manner], *, every_layer: bool = False,
                  most_tiles: int | None = None) -> dict[str, list[Any]]:  # fmt: skip
    """Decode files in every way and compare all exact arrays with those of the usual way.

    Args:
        paths: the files.
        ways: by name.
        every_layer: to each layer, not only to the last.
        most_tiles: only so many tiles of each.

    Returns:
        For each way the number of decodes, of arrays, and the names of those that differ.
    """
    out: dict[str, list[Any]] = {name: [0, 0, []] for name in ways}
    for path in paths:
        usual = decoding(path, None, BASE, most_tiles)
        count = len(usual.models.model.layers)
        for layers in range(1 if every_layer else count, count + 1):
            wanted = digests(usual if layers == count else decoding(path, layers, BASE, most_tiles))
            for name, manner in ways.items():
                found = _found(path, layers, manner, most_tiles)
                place = f"{path.parent.name}/{path.name} to layer {layers}"
                wrong = [f"{place}: {key}" for key in wanted if found.get(key) != wanted[key]]
                out[name] = [out[name][0] + 1, out[name][1] + len(wanted), out[name][2] + wrong]
    return out


def _found(path: Path, layers: int, manner: Manner, most_tiles: int | None) -> Digests:
    """Digests, none where the file is refused: a way that refuses what another decodes differs in everything."""
    try:
        return digests(decoding(path, layers, manner, most_tiles))
    except ScarError:
        return {}


def added(*parts: Mapping[str, list[Any]]) -> dict[str, list[Any]]:
    """Comparisons of several sets of files, by way."""
    out: dict[str, list[Any]] = {}
    for part in parts:
        for name, (decodes, arrays, wrong) in part.items():
            before = out.get(name, [0, 0, []])
            out[name] = [before[0] + decodes, before[1] + arrays, before[2] + wrong]
    return out


def measure_files(real: Path, large: Sequence[Path], short: bool) -> dict[str, list[Any]]:
    """The example scene and the conformance vectors in every way, and a few tiles of what large files there are."""
    ways, networks = manners(), neural_vectors()
    if short:
        return compare_files([real, *networks[::6]], ways | orders(3))
    plain = {name: way for name, way in ways.items() if name.startswith(("threads", "access", "compiled kernel"))}
    others = [path for path in vectors() if path not in networks]
    few = {name: way for name, way in ways.items() if "rows at a time" not in name} | orders(_LARGE_ORDERS)
    return added(
        compare_files([real], ways, every_layer=True),
        compare_files([real, *networks], orders()),
        compare_files(networks, ways),
        compare_files(others, plain),
        compare_files(large, few, most_tiles=_LARGE_TILES),
    )


def measure_processes(real: Path, short: bool) -> dict[str, Any]:
    """Digests of files decoded in processes of other kinds."""
    some = {name: way for name, way in environments().items() if not short or name in _SHORT_PROCESSES}
    return decoded_elsewhere(some, [real, *neural_vectors()[:: 6 if short else 2]], real)


def measure_encoder(scene: Path, short: bool) -> dict[str, str]:
    """The encoded bytes of a part of the example, by kind of process."""
    some = encoder_environments()
    if short:
        some = {name: some[name] for name in ("as usual", "hash seed 1")}
    return {name: encode_in(way, scene, 500 if short else 1000, 1 if short else 2) for name, way in some.items()}


def measure_activated(short: bool) -> list[Results]:
    """The worst case of every value with a tolerance, and how much of it the reference itself leaves open."""
    out = []
    for activation in activations():
        found = search(activation.operation, 20_000 if short else 400_000, 12 if short else 120)
        inputs = found.inputs, *activation.hard
        row = {"operation": activation.operation.name, "columns": activation.operation.columns, **asdict(found)}
        out.append({**row, "reference": reference_error(activation, inputs, 100 if short else 2000)})
    sizes = (30, 100, 6) if short else (200, 400, 100)
    for operation, worst in measure_networks(*sizes):
        out.append({"operation": operation.name, "columns": operation.columns, **asdict(worst), "reference": None})
    return out


def measure_profiles(short: bool) -> dict[str, list[float]]:
    """The part of the tolerance used, by the magnitude of the inputs."""
    count = 500 if short else 20_000
    return {one.operation.name: profile(one.operation, EXPONENTS, count) for one in activations()}


def plot(profiles: Mapping[str, Sequence[float]], keep: bool) -> None:
    """docs/images/stability-magnitude.svg."""
    figure, axes = new_plot(
        "magnitude of the inputs, power of two",
        "worst error / tolerance",
        log_y=True,
        title="Activated values, float32",
    )
    for number, (name, used) in enumerate(profiles.items()):
        points = [(exponent, value) for exponent, value in zip(EXPONENTS, used, strict=True) if value > 0]
        line(axes, [x for x, _ in points], [y for _, y in points], name, number)
    axes.axhline(1.0, color="black", linewidth=0.8)
    axes.set_ylim(1e-6, 1e6)
    save_plot(figure, "stability-magnitude", keep)


def measure(short: bool, scenes: Sequence[str] | None) -> Results:
    """Everything."""
    example = chosen([EXAMPLE])[0]
    real = Path(encoded(example, QUALITY, 1 if short else 2)["path"])
    others = [] if short else [encoded_path(scene, QUALITY, 2) for scene in chosen(scenes) if scene.name != EXAMPLE]
    large = [path for path in others if path.exists()]
    return {
        "files": measure_files(real, large, short),
        "real": [EXAMPLE, *(path.name for path in large)],
        "processes": measure_processes(real, short),
        "encoder": measure_encoder(example.path, short),
        "exact": measure_values(400 if short else 10_000) + measure_edges(),
        "activated": measure_activated(short),
        "profiles": measure_profiles(short),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    asked = parser.parse_args(arguments)
    results = measure(asked.short, asked.scenes)
    keep = not (asked.short or asked.no_write)
    save_results(NAME, results, keep)
    plot(results["profiles"], keep)
    text = dated(markdown(results), NAME, keep)
    if keep:
        replace_section(NAME, text, PAGE)
    else:
        print(text)
    wrong = failures(results)
    if wrong:
        sys.exit("\n".join(["not stable:", *wrong]))


if __name__ == "__main__":
    main()

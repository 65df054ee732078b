"""The bytes of positions: the binary splits of SPEC §7.2 against order-0 octrees, on real scenes.

    python -m benchmarks.positions [--scenes NAME ...] [--short] [--no-write]

All anchors are coded as one tile on one lattice, whose voxel is chosen so that the 1-99 % core takes 12 or 14 bits on
its longest axis. Ours is the length of a real sealed stream and its packed tables, read back. The octrees are code
lengths of ideal coders that nobody wrote; none of them pays for a table.
"""

from __future__ import annotations

import argparse
import math
import sys
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import add_arguments, dated, load_results, replace_section, save_results, table
from benchmarks.scenes import SCENES, chosen
from scarfmt.arrays import I64, U64
from scarfmt.blocks.tables import fit_table, pack_table
from scarfmt.cli.scenes import load_subject
from scarfmt.codecs.positions import get_positions, put_positions
from scarfmt.container.morton import interleave
from scarfmt.entropy.emitters import SymbolCounter, SymbolWriter
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.limits import MAX_LOCAL_BITS

NAME = "positions"
CORE_BITS = (12, 14)


def lattice_codes(positions: NDArray[np.float64], core_bits: int) -> tuple[U64, int] | None:
    """Sorted Morton codes and bits per axis; None where outliers need more bits than a tile has."""
    low, high = np.percentile(positions, [1, 99], axis=0)
    points = np.floor((positions - positions.min(axis=0)) / ((high - low).max() / 2**core_bits))
    bits = int(points.max()).bit_length()
    return (np.sort(interleave(points.astype(np.uint64))), bits) if bits <= MAX_LOCAL_BITS else None


def our_bytes(codes: U64, bits: int) -> int:
    """Bytes of the written stream and its tables.

    Raises:
        AssertionError: it does not read back as it was.
    """
    counter = SymbolCounter()
    put_positions(counter, codes, bits)
    tables = {key: fit_table(alphabet, counts) for key, (alphabet, counts) in counter.histograms().items()}
    writer = SymbolWriter(tables)
    put_positions(writer, codes, bits)
    data = writer.finish()
    reader = SymbolReader(data, tables)
    assert np.array_equal(get_positions(reader, len(codes), bits), codes)
    reader.finish()
    return len(data) + sum(len(pack_table(key, symbol_table)) for key, symbol_table in tables.items())


def occupancy_counts(codes: U64, bits: int) -> list[I64]:
    """How often each occupancy byte occurs, (256,) for each octree level."""
    levels = []
    for level in range(bits):
        children = np.unique(codes >> np.uint64(3 * (bits - level - 1)))
        _, parent = np.unique(children >> np.uint64(3), return_inverse=True)
        occupied = np.bincount(parent, weights=1 << (children & np.uint64(7)).astype(np.int64))
        levels.append(np.bincount(occupied.astype(np.int64), minlength=256))
    return levels


def static_bits(counts: I64) -> float:
    """Symbols under their own frequencies."""
    present = counts[counts > 0]
    return float(-(present * np.log2(present / present.sum())).sum())


def adaptive_bits(counts: I64, alphabet: int) -> float:
    """Symbols under an adaptive model that starts each of `alphabet` counts at 1/2 (Krichevsky-Trofimov)."""
    learnt = math.lgamma(counts.sum() + alphabet / 2) - math.lgamma(alphabet / 2)
    return (learnt - sum(math.lgamma(n + 0.5) - math.lgamma(0.5) for n in counts.tolist() if n)) / math.log(2)


def measure(positions: NDArray[np.float64], core_bits: int) -> dict[str, Any] | None:
    """Bits per anchor of each coder; None where the lattice does not fit."""
    lattice = lattice_codes(positions, core_bits)
    if lattice is None:
        return None
    codes, bits = lattice
    levels = occupancy_counts(codes, bits)
    crowd = np.bincount(np.unique(codes, return_counts=True)[1])
    count = len(codes)
    return {
        "count": count,
        "core_bits": core_bits,
        "alone": float(len(np.unique(codes)) / count),
        "ours": 8 * our_bytes(codes, bits) / count,
        "octree_adaptive": sum(adaptive_bits(level, 255) for level in levels) / count,
        "octree_static": sum(map(static_bits, levels)) / count,
        "leaf_counts": adaptive_bits(crowd[1:], len(crowd) - 1) / count,
    }


def markdown(results: dict[str, Any]) -> str:
    """The table of the page."""
    order = {scene.name: number for number, scene in enumerate(SCENES)}
    rows = []
    for run in sorted(results.values(), key=lambda run: (order.get(run["scene"], len(order)), run["core_bits"])):
        numbers = [run["ours"], run["octree_adaptive"] + run["leaf_counts"], run["octree_adaptive"]]
        cells = [f"{number:.2f}" for number in [*numbers, run["octree_static"]]]
        rows.append([run["scene"], f"{run['count']:,}", str(run["core_bits"]), f"{run['alone']:.1%}", *cells])
    head = [
        "scene",
        "anchors",
        "core bits",
        "cells used / anchors",
        "`.scar`, tables included",
        "adaptive octree, whole",
        "adaptive octree, occupancy only",
        "static octree, occupancy only",
    ]
    return f"Bits per anchor.\n\n{table(head, rows)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    arguments = parser.parse_args()
    results = {} if arguments.no_write else load_results(NAME)
    measured, names = set(), []
    for scene in chosen(arguments.scenes or (["plush-toys"] if arguments.short else None)):
        if scene.path in measured:
            continue
        measured.add(scene.path)
        positions = load_subject(str(scene.path)).placed.positions
        for core_bits in CORE_BITS:
            figures = measure(positions, core_bits)
            if figures is None:
                print(f"{scene.name}: outliers need over {MAX_LOCAL_BITS} bits at {core_bits}", file=sys.stderr)
            else:
                names.append(f"{scene.name} {core_bits}")
                results[names[-1]] = {"scene": scene.name, **figures}
    save_results(NAME, results, not arguments.no_write, names)
    show = print if arguments.no_write else partial(replace_section, NAME)
    show(dated(markdown(results), NAME, not arguments.no_write))


if __name__ == "__main__":
    main()

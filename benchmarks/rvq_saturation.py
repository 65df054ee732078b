"""The saturation of residual vector quantisation: the tables of docs/decisions/0035-rvq-or-trits.md.

    python -m benchmarks.rvq_saturation plush-on-bed.npz
    python -m benchmarks.rvq_saturation --short                 few vectors of the example scene, small codebooks

It prints its tables and writes nothing. Vectors are the features of a finished anchor model, all alike in weight. Each
book is trained as a scene trains it: principal axes, k-means, then moving averages over batches whose codewords were
chosen by distortion plus lambda times bits. Errors are those of the exported integers, in dB relative to sending the
mean. Bits an anchor are those of the static tables that a writer would fit, and of the tables themselves; of codewords
as packed, too. Both sides need the same decoder, which is not counted.
"""

from __future__ import annotations

import argparse
import copy
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from benchmarks.report import add_arguments, table
from benchmarks.scenes import chosen
from reference_encoder.decide.rdo import choose_values
from reference_encoder.measure.attributes import from_scene
from reference_encoder.training.fixed_latents import Exported, export
from reference_encoder.training.quantiser import Quantiser
from scarfmt.arrays import F32, F64, I64
from scarfmt.blocks.codebooks import pack_codebooks
from scarfmt.blocks.tables import fit_table, pack_tables
from scarfmt.container.bytefields import compress
from scarfmt.container.schema import Stream
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.formats import anchor_npz, inria_ply
from scarfmt.formats.source import Source

STAGES, BATCH, ROUNDS = 4, 4096, 60
LAMBDAS = (0.0, 0.004)
"""Prices of a bit, in the vectors' mean energy."""
DEAD_ZONE = 0.15
"""Lambda of scalar rounding, in squared steps a bit: about the slope of a uniform quantiser."""
Points = list[tuple[float, float]]
"""(bits an anchor, mean squared error), bits ascending."""


@dataclass(frozen=True)
class Case:
    """Vectors to code.

    Attributes:
        x: (N, D) float32.
        energy: mean squared distance to the mean.
    """

    x: F32
    energy: float

    def decibels(self, error: float) -> float:
        """A mean squared error in dB, relative to sending the mean."""
        return float(10 * np.log10(error / self.energy))


def table_bits(symbols: Mapping[TableKey, I64]) -> float:
    """The bits of symbols and their static tables."""
    tables: dict[TableKey, SymbolTable] = {}
    bits = 0.0
    for key, values in symbols.items():
        alphabet, counts = np.unique(values, return_counts=True)
        tables[key] = fit_table(alphabet.astype(np.int64), counts.astype(np.int64))
        bits += float((tables[key].table.bits * counts).sum())
    return bits + 8 * len(compress(pack_tables(tables)))



def scalar_bits(q: I64) -> float:
    """The bits of (N, d) integers under static tables, one a column."""
    return table_bits({TableKey(Stream.LATENT, k, 1, 0): column for k, column in enumerate(q.T)})


def rounded(x: F64, step: float) -> I64:
    """(N, d) integers near `x` / step, cheaper ones where the error allows it."""
    classes = np.zeros(len(x), np.int64)
    return choose_values(x / step, np.full(x.shape, step * step), classes, DEAD_ZONE * step * step)


def index_bits(indices: I64, stages: int) -> float:
    """The bits of the first stages of (N, M) indices. Contexts are those of SPEC §7.6 for one class."""
    symbols: dict[TableKey, I64] = {}
    for stage in range(stages):
        zero = indices[:, stage - 1] == 0 if stage else np.zeros(len(indices), np.bool_)
        for context in (0, 1):
            if (zero == context).any():
                symbols[TableKey(Stream.INDICES, stage, 0, context)] = indices[zero == context, stage]
    return table_bits(symbols)


def book_bits(made: Exported, stages: int) -> float:
    """The bits of the codebooks of the first stages."""
    books = {0: made.codebooks.coarse, 1: made.codebooks.residual}
    return 8.0 * len(pack_codebooks({number: words for number, words in books.items() if number < min(stages, 2)}))


def trained(start: Quantiser, f: torch.Tensor, lambda_: float, rounds: int) -> Exported:
    """The books after they have followed the choices at a lambda."""
    quantiser, generator = copy.deepcopy(start), torch.Generator().manual_seed(1)
    z = quantiser.project(f).detach()
    for _ in range(rounds):
        batch = z[torch.randint(len(z), (min(BATCH, len(z)),), generator=generator)]
        quantiser.update(batch, quantiser.choose(batch, quantiser.bits(), lambda_))
    indices = quantiser.choose(z, quantiser.bits(), lambda_)
    return export(quantiser, f, indices, torch.full((len(f),), STAGES))


def error_after(case: Case, made: Exported, z: F32) -> float:
    """Mean squared error of what the stored decoder makes of (N, d) latents."""
    return float(np.square(made.decoder.apply(z) - case.x).sum(axis=1).mean())


def sums_after(made: Exported, stages: int) -> F32:
    """(N, d) sums of codewords."""
    received = np.full(len(made.indices), stages)
    return made.codebooks.latents(made.indices.astype(np.int64), received).astype(np.float32)


def refined(case: Case, made: Exported, stages: int, steps: Sequence[float]) -> Points:
    """The curves of scalar refinements after the first stages, by steps in lattice units; no stage is scalar alone."""
    sums = sums_after(made, stages)
    fixed = index_bits(made.indices.astype(np.int64), stages) + book_bits(made, stages) if stages else 0.0
    points = []
    for step in steps:
        q = rounded((made.latents - sums).astype(np.float64), step)
        error = error_after(case, made, sums + (q * step).astype(np.float32))
        points.append(((fixed + scalar_bits(q)) / len(case.x), error))
    return sorted(points)


def at_bits(case: Case, points: Points, bits: float) -> str:
    """dB at a number of bits, straight between measured points; a dash beyond them."""
    known = np.array(points)
    if not known[0, 0] <= bits <= known[-1, 0]:
        return "–"
    return f"{np.interp(bits, known[:, 0], 10 * np.log10(known[:, 1] / case.energy)):.2f}"


def stage_rows(case: Case, name: str, made: Exported, scalar: Points) -> list[list[str]]:
    """A row a stage: bits of indices and of codebooks, dB, and what scalar quantisation has at as many bits."""
    rows = []
    for stage in range(1, STAGES + 1):
        indices = index_bits(made.indices.astype(np.int64), stage) / len(case.x)
        books = book_bits(made, stage) / len(case.x)
        error = case.decibels(error_after(case, made, sums_after(made, stage)))
        equal = [at_bits(case, scalar, bits) for bits in (indices + books, indices)]
        rows.append([name, str(stage), f"{indices:.1f}", f"{books:.1f}", f"{error:.2f}", *equal])
    return rows


def measured(case: Case, sizes: Sequence[int], rounds: int, totals: Sequence[float]) -> None:
    """Print the tables."""
    f, weight, began = torch.from_numpy(case.x), torch.ones(len(case.x)), time.perf_counter()
    told: list[list[str]] = []
    mixed: list[list[str]] = []
    scalar: Points = []
    for size in sizes:
        start = Quantiser(min(case.x.shape[1], 64), case.x.shape[1], STAGES, size)
        start.fit(f, weight)
        start.start(start.project(f), weight)
        for lambda_ in LAMBDAS:
            made = trained(start, f, lambda_ * case.energy, rounds)
            if not scalar:
                scalar = refined(case, made, 0, steps_for(made))
                mixed.append(["none", *(at_bits(case, scalar, bits) for bits in totals)])
            told += stage_rows(case, f"{size}, {lambda_:g}", made, scalar)
        for stages in range(1, STAGES + 1):
            points = refined(case, made, stages, steps_for(made))
            mixed.append([f"{stages} of {size}", *(at_bits(case, points, bits) for bits in totals)])
    head = ["codewords, lambda", "stages", "indices", "codebooks", "dB", "scalar, all bits", "scalar, indices alone"]
    print(f"\n{case.x.shape[0]} x {case.x.shape[1]}, {time.perf_counter() - began:.0f} s\n")
    print(table(head, told))
    print(table(["stages before scalar", *(f"{bits:g} bits" for bits in totals)], mixed))


def steps_for(made: Exported) -> list[float]:
    """Steps from fine to so coarse that next to nothing is said, in lattice units."""
    spread = float(np.sqrt(np.square(made.latents).mean()))
    return [spread * float(factor) for factor in np.geomspace(0.3, 8, 9)]


def case_of(x: F32) -> Case:
    """Vectors as they are."""
    return Case(x, float(np.square(x - x.mean(axis=0)).sum(axis=1).mean()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path, nargs="?", help="an anchor model; default: SH of the example scene")
    add_arguments(parser, scenes=False)
    arguments = parser.parse_args()
    if arguments.model is not None:
        x = anchor_npz.load(Source(arguments.model)).features
    else:
        x = from_scene(inria_ply.load(Source(chosen(["plush-toys"])[0].path))).rest
    if arguments.short:
        measured(case_of(x[:: max(len(x) // 1500, 1)]), (16,), 5, (10, 30))
        return
    measured(case_of(x), (256, 1024), ROUNDS, (20, 40, 60, 90, 120))


if __name__ == "__main__":
    main()

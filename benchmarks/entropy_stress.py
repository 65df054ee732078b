"""Numerical stress of the index network: every way to compute it must give the integers of the oracle.

    python -m benchmarks.entropy_stress            some dozen networks, under a minute; prints and writes nothing
    python -m benchmarks.entropy_stress --full     hundreds, and training in three precisions; rewrites
                                                   docs/entropy-stress.md and its JSON

Random valid networks, half of them with biases that bring every accumulator to the largest reach allowed; ordinary and
extreme inputs. The oracle is in Python integers, one anchor at a time. Exits with 1 if anything differs.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.entropy_operations import CountingOperations, DoubleOperations, ShuffledOperations
from benchmarks.entropy_precision import measure_training, training_rows
from benchmarks.report import dated, replace_section, save_results, table
from benchmarks.scenes import REPOSITORY
from conformance.writer.oracle import Oracle
from fuzz.testing.network_rows import first_rows, member_rows
from reference_decoder.torch_operations import TorchOperations
from scarfmt.arrays import I64
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.evaluator import Evaluator
from scarfmt.neural.network import Head, Inputs
from scarfmt.neural.operations import NumpyOperations, Operations
from scarfmt.scene.codebooks import Codebooks
from tests.neural.networks import Case, random_books, random_network

NAME = "entropy-stress"
PAGE = REPOSITORY / "docs" / "entropy-stress.md"
NETWORKS, NETWORKS_FULL = 60, 600
ORDERS = 20
CHUNKS = (1, 3, 64)
_ORACLE_ANCHORS, _ANCHORS = 3, 48
_KINDS = ("random", "edge", "equal logits", "ties", "one symbol")
_SEED_OF_ORDERS = 1

Rows = list[NDArray[Any]]


@dataclass(frozen=True)
class Question:
    """A network and what it is asked.

    Attributes:
        kind: of network.
        case: the network.
        x: (n, width) int64.
        codes: (n, stages known) int64.
    """

    kind: str
    case: Case
    x: I64
    codes: I64

    def part(self, rows: I64) -> Question:
        """The case reduced to some anchors."""
        return replace(self, x=self.x[rows], codes=self.codes[rows])


def make_question(seed: int) -> Question:
    """A function that makes one question of each kind in turn."""
    rng = np.random.default_rng(seed)
    kind, stages = _KINDS[seed % len(_KINDS)], int(rng.integers(1, 5))
    sizes = (1, 1) if kind == "one symbol" else (int(rng.integers(2, 40)), int(rng.integers(2, 40)))
    books = random_books(rng, sizes[0], sizes[1] if stages > 1 else 0, int(rng.integers(1, 7)))
    if kind == "ties":
        books = Codebooks(books.coarse[np.arange(sizes[0]) // 2], books.residual[np.arange(len(books.residual)) // 2])
    inputs = Inputs(
        classes=int(rng.integers(0, 4)), own=bool(rng.integers(2)), attributes=int(rng.integers(1, 9)),
        depths=int(rng.integers(1, 3)), latents=1, latent_shift=2, grid=int(rng.integers(0, 20)),
    )  # fmt: skip
    network = random_network(
        rng, books, inputs, stages=stages, hidden=int(rng.integers(1, 25)), mixed=int(rng.integers(1, 25)),
        activation_bits=int(rng.integers(8, 13)), two_level=bool(rng.integers(2)), attention=bool(rng.integers(2)),
        gru_layers=int(rng.integers(1, 3)), edge=kind == "edge", pre_activation=float(rng.choice([96, 3000, 1e6])),
    )  # fmt: skip
    if kind in ("equal logits", "ties"):
        network = replace(network, heads=tuple(_without_biases(head, kind == "ties") for head in network.heads))
    case = Case(books, stages, network)
    network.check(books, stages)
    known = int(rng.integers(0, stages))
    columns = [rng.integers(0, books.sizes[stage > 0], _ANCHORS) for stage in range(known)]
    return Question(kind, case, _inputs(rng, case), np.array(columns, np.int64).reshape(known, _ANCHORS).T)


def _without_biases(head: Head, keep_projections: bool) -> Head:
    """Logits that are all equal, or equal for equal codewords."""
    silent = tuple(Linear(0 * layer.weights, 0 * layer.biases, layer.shift) for layer in head.projections)
    return replace(
        head,
        projections=head.projections if keep_projections else silent,
        cluster_biases=0 * head.cluster_biases,
        biases=0 * head.biases,
    )


def _inputs(rng: np.random.Generator, case: Case) -> I64:
    """Ordinary, beyond the clamps, and, row by row, those that push one unit of the embedding farthest."""
    amax = case.network.amax
    x = rng.integers(-amax, amax + 1, (_ANCHORS, case.network.inputs.width))
    x[1::4] = rng.integers(-(1 << 40), 1 << 40, x[1::4].shape)
    x[2::4] = rng.choice([-amax, amax], x[2::4].shape)
    first = case.network.embed[0]
    units = rng.integers(0, first.outputs, len(x[::4]))
    x[::4] = np.where(first.weights[units] * np.where(first.biases[units] < 0, -1, 1)[:, None] < 0, -amax, amax)
    return x


def rows_of(evaluator: Evaluator, question: Question) -> Rows:
    """Frequencies less 1 of the next symbol (flat), or of the cluster and of all members (two-level)."""
    book = int(question.codes.shape[1] > 0)
    state = evaluator.start(len(question.x))
    for stage, column in enumerate(question.codes.T, start=1):
        state = evaluator.advance(state, stage, column)
    y = evaluator.mixed(evaluator.embed(question.x), state)
    head = question.case.network.heads[book]
    if not head.two_level:
        return [first_rows(evaluator, book, y)]
    return [first_rows(evaluator, book, y), *(member_rows(evaluator, book, y, i) for i in range(len(head.clusters)))]


def oracle_rows(question: Question) -> Rows:
    """The products in Python integers."""
    case, book = question.case, int(question.codes.shape[1] > 0)
    oracle = Oracle(case.network, case.books.coarse.tolist(), case.books.residual.tolist())
    ys = [oracle.context(x, codes) for x, codes in zip(question.x.tolist(), question.codes.tolist(), strict=True)]
    head = case.network.heads[book]
    if not head.two_level:
        return [np.array([oracle.top(book, y) for y in ys]) - 1]
    members = [np.array([oracle.members(book, y, i) for y in ys]) - 1 for i in range(len(head.clusters))]
    return [np.array([oracle.top(book, y) for y in ys]) - 1, *members]


def equal(found: Rows, wanted: Rows) -> bool:
    """Whether all numbers are the same."""
    return len(found) == len(wanted) and all(np.array_equal(a, b) for a, b in zip(found, wanted, strict=True))


def _in_orders(evaluator: Evaluator, question: Question, wanted: Rows, threads: int) -> bool:
    """Whether random orders, cut into random batches that run side by side, give each anchor its row."""
    rng, count = np.random.default_rng(_SEED_OF_ORDERS), len(question.x)
    with ThreadPoolExecutor(threads) as pool:
        for _ in range(ORDERS):
            cuts = np.sort(rng.integers(0, count + 1, 3))
            batches = np.split(rng.permutation(count), cuts)
            found = pool.map(lambda rows: rows_of(evaluator, question.part(rows)), batches)
            for rows, some in zip(batches, found, strict=True):
                if not equal(some, [whole[rows] for whole in wanted]):
                    return False
    return True


def ways(question: Question, counting: CountingOperations) -> dict[str, Callable[[], bool]]:
    """Every way to compute a question, by name; each says whether it gives the right rows."""
    case = question.case
    some = question.part(np.arange(_ORACLE_ANCHORS))

    def evaluator(do: Operations) -> Evaluator:
        return Evaluator(case.network, case.books, do)

    wanted = rows_of(evaluator(NumpyOperations()), question)

    def whole(do: Operations) -> bool:
        return equal(rows_of(evaluator(do), question), wanted)

    out: dict[str, Callable[[], bool]] = {
        "the oracle, Python integers": lambda: equal([rows[: len(some.x)] for rows in wanted], oracle_rows(some))
    }
    for chunk in CHUNKS:
        out[f"NumPy, {chunk} row{'s' * (chunk > 1)} at a time"] = partial(whole, _chunked(chunk))
    for threads in (1, 4):
        name = f"NumPy, {ORDERS} batch orders, {threads} thread{'s' * (threads > 1)}"
        out[name] = partial(_in_orders, evaluator(NumpyOperations()), question, wanted, threads)
    out["torch, CPU"] = partial(whole, TorchOperations("cpu"))
    out["torch, CPU, 2 rows at a time"] = partial(whole, TorchOperations("cpu", chunk=2))
    out["float32, sums in random order"] = partial(whole, ShuffledOperations(len(question.x)))
    out["float64"] = partial(whole, DoubleOperations())
    out["float64, counting"] = partial(whole, counting)
    return out


def _chunked(rows: int) -> NumpyOperations:
    do = NumpyOperations()
    do.chunk = rows
    return do


def measure_networks(count: int) -> dict[str, Any]:
    """Networks, frequencies compared and differences of every way, and the extremes counted on the way."""
    counting = CountingOperations()
    kinds: dict[str, int] = dict.fromkeys(_KINDS, 0)
    compared: dict[str, list[int]] = {}
    numbers = 0
    for seed in range(count):
        question = make_question(seed)
        kinds[question.kind] += 1
        for name, holds in ways(question, counting).items():
            figures = compared.setdefault(name, [0, 0])
            figures[0] += 1
            figures[1] += not holds()
        numbers += sum(rows.size for rows in rows_of(Evaluator(question.case.network, question.case.books), question))
    return {"kinds": kinds, "compared": compared, "frequencies": numbers, "extremes": counting.report()}


def _network_tables(found: dict[str, Any]) -> list[str]:
    kinds = ", ".join(f"{count} {kind}" for kind, count in found["kinds"].items())
    ways_rows = [[name, f"{count:,}", str(wrong)] for name, (count, wrong) in found["compared"].items()]
    extremes = [[row["what"], row["seen"], row["limit"]] for row in found["extremes"]]
    return [
        "### Equal rows",
        f"Networks: {kinds}. {found['frequencies']:,} frequencies, of {_ANCHORS} anchors a network; the oracle "
        f"computes those of {_ORACLE_ANCHORS}.",
        table(["computed by", "networks", "of which differ"], ways_rows).rstrip(),
        "### Largest values seen in them",
        table(["value", "largest seen", "limit"], extremes).rstrip(),
    ]


def markdown(results: dict[str, Any]) -> str:
    """The tables of the page."""
    parts = _network_tables(results["networks"])
    if "training" in results:
        head = ["products in", "network", "bits an index, as trained", "bits an index in the file", "lost"]
        parts += ["### Training precision", table(head, training_rows(results["training"]), 2).rstrip()]
    return "\n\n".join(parts)


def failures(results: dict[str, Any]) -> int:
    """How many comparisons failed."""
    return sum(wrong for _, wrong in results["networks"]["compared"].values())


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--full", action="store_true", help="more networks, and training; keeps the results")
    parser.add_argument("--short", action="store_true", help="some dozen networks; the default")
    parser.add_argument("--no-write", action="store_true", help="with --full: print the tables instead")
    chosen = parser.parse_args(arguments)
    count = NETWORKS_FULL if chosen.full else NETWORKS
    results: dict[str, Any] = {"networks": measure_networks(count)}
    if chosen.full:
        results["training"] = measure_training()
    keep = chosen.full and not chosen.no_write
    save_results(NAME, results, keep)
    show = partial(replace_section, NAME, page=PAGE) if keep else print
    show(dated(markdown(results), NAME, keep))
    if failures(results):
        sys.exit("results differ")


if __name__ == "__main__":
    main()

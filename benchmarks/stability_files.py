"""Whole files decoded in every way there is: hashes of all that SPEC §9 calls exact (exact stages of PROTOCOL.md)."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from scarfmt_conformance.reference.observed import Records
from scarfmt_conformance.reference.stages import EXACT, Decoding, models

from benchmarks.entropy_operations import DoubleOperations, IntegerOperations, PermutedOperations
from benchmarks.scenes import REPOSITORY
from reference_decoder.backends import operations
from scarfmt.arrays import F32, I64
from scarfmt.coding.models import SceneModels
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import NeuralModels, TileContent
from scarfmt.container.source import open_source
from scarfmt.engines import absence, engine_named
from scarfmt.errors import InvalidInput
from scarfmt.neural.arithmetic import Linear, round_shift
from scarfmt.neural.operations import NumpyOperations, Operations
from scarfmt.neural.predictors import AMAX, Predictor

VECTORS = REPOSITORY / "conformance" / "vectors"
ORDERS = 20
CHUNKS = (1, 7, 64, 1 << 20)
THREADS = (2, 4)

Digests = dict[str, str]


@dataclass(frozen=True)
class Manner:
    """How a file is decoded.

    Attributes:
        make: the operations of the index network.
        threads: tiles decoded side by side.
        in_memory: from bytes; else by ranges of the file.
        tile_by_tile: a reader of its own for each tile.
        seed: of a random order of the tiles, and without the compiled kernel of the sums of predictors; None for the
            usual ones.
        whole: predictors in int64; needs `bare`.
        bare: without the compiled kernel, which knows float32 arrays and its own predictors only.
    """

    make: Callable[[], Operations] = NumpyOperations
    threads: int = 1
    in_memory: bool = False
    tile_by_tile: bool = False
    seed: int | None = None
    whole: bool = False
    bare: bool = False


BASE = Manner()


@dataclass(frozen=True)
class OtherPredictor:
    """A predictor with its products in another order, or in int64; no :class:`Predictor`, so evaluated alone."""

    of: Predictor
    seed: int | None

    def contexts(self, x: F32) -> I64:
        """Contexts by shuffled products; equal to those of :meth:`Predictor.contexts`."""
        if self.seed is None:
            return self._whole(x.astype(np.int64))
        rng = np.random.default_rng(self.seed)
        rows, columns = rng.permutation(len(x)), rng.permutation(x.shape[1])
        hidden, output = self.of.hidden, self.of.output
        turned = output.weights[:, np.concatenate([columns, np.arange(x.shape[1], output.inputs)])]
        other = replace(
            self.of,
            hidden=None if hidden is None else replace(hidden, weights=hidden.weights[:, columns]),
            output=replace(output, weights=turned),
        )
        out = np.empty(len(x), np.int64)
        out[rows] = other.contexts(x[np.ix_(rows, columns)])
        return out

    def _whole(self, x: I64) -> I64:
        p = self.of
        if p.hidden is not None:
            x = np.concatenate([x, np.clip(self._rounded(p.hidden, x), 0, AMAX)], axis=1)
        numbers = self._rounded(p.output, x).T
        one, two = (np.clip(number, 0, top - 1) for number, top in zip(numbers, p.buckets, strict=True))
        out: I64 = one * p.buckets[1] + two
        return out

    @staticmethod
    def _rounded(layer: Linear, x: I64) -> I64:
        return round_shift(x @ layer.weights.T.astype(np.int64) + layer.biases, layer.shift)


class OtherModels(SceneModels):
    """Models whose predictors are :class:`OtherPredictor`."""

    seed: int | None = None

    def neural(self, *arguments: Any, **named: Any) -> tuple[NeuralModels, ...]:
        """Networks with shuffled products, in place of :meth:`SceneModels.neural`."""
        found = super().neural(*arguments, **named)
        made: dict[int, OtherPredictor] = {}
        return tuple(
            replace(one, predictors={key: self._other(made, p) for key, p in one.predictors.items()}) for one in found
        )

    def _other(self, made: dict[int, OtherPredictor], predictor: Any) -> OtherPredictor:
        return made.setdefault(id(predictor), OtherPredictor(predictor, self.seed))


def _models(found: SceneModels, manner: Manner) -> SceneModels:
    uses_kernel = absence() is None and not manner.bare
    if uses_kernel or (manner.seed is None and not manner.whole):
        return found
    other = OtherModels(**vars(found))
    object.__setattr__(other, "seed", manner.seed)
    return other


def decoding(path: Path, layers: int | None, manner: Manner = BASE, most_tiles: int | None = None) -> Decoding:
    """A file decoded to a layer.

    Args:
        path: of it.
        layers: to decode; None for all.
        manner: how.
        most_tiles: only so many of its tiles, evenly spread.

    Raises:
        Malformed, Unsupported, LimitExceeded: the file is refused.
    """
    engine = engine_named("numpy" if manner.bare else "auto", manner.make())
    with open_source(path.read_bytes() if manner.in_memory else path) as source:
        reader = SceneReader(source, engine=engine)
        scene = _models(reader.models(layers), manner)
        count = reader.header.tile_count
        tiles = np.unique(np.linspace(0, count - 1, min(count, most_tiles or count)).round().astype(int))
        if manner.seed is not None:
            tiles = np.random.default_rng(manner.seed).permutation(tiles)
        records = Records(len(scene.model.layers))
        groups = [[tile] for tile in tiles.tolist()] if manner.tile_by_tile else [tiles.tolist()]
        found: dict[int, TileContent] = {
            tile: content
            for group in groups
            for tile, content in reader.tiles(scene, group, threads=manner.threads, observe=records.observe)
        }
        empty = TileContent.empty(scene.model)
        whole = Decoding(reader, scene, [found.get(tile, empty) for tile in range(count)], records)
        # While the source is open: a decoding reads no more, but its arrays are made when they are asked for.
        assert len(whole.decoded) == sum(map(len, found.values()))
        return whole


def digests(found: Decoding) -> Digests:
    """SHA-256 of every exact array: models, contexts, frequencies, indices, integers, sums, values."""
    stages = {"models": models(found.models), **{stage: arrays(found) for stage, arrays in EXACT.items()}}
    return {
        f"{stage}: {name}": hashlib.sha256(
            f"{array.dtype.str}{array.shape}".encode() + np.ascontiguousarray(array).tobytes()
        ).hexdigest()
        for stage, arrays in stages.items()
        for name, array in arrays.items()
    }


def _limited(chunk: int) -> NumpyOperations:
    do = NumpyOperations()
    do.chunk = chunk
    return do


def _backends() -> Iterator[tuple[str, Manner]]:
    for backend in ("torch", "cuda"):
        do = partial(operations, backend)
        try:
            do()
        except InvalidInput:
            continue
        yield f"backend: {backend}", Manner(make=do)
        yield f"backend: {backend}, 4 threads", Manner(make=do, threads=4)


@cache
def manners() -> dict[str, Manner]:
    """Every other way, by name: what the part before the colon says is what differs from the usual way."""
    out = {f"threads: {threads}": Manner(threads=threads) for threads in THREADS}
    for rows in CHUNKS:
        out[f"rows at a time: at most {rows:,}"] = Manner(make=partial(_limited, rows))
    out |= dict(_backends())
    out["arithmetic: float64"] = Manner(make=DoubleOperations, bare=True)
    out["arithmetic: int64, predictors too"] = Manner(make=IntegerOperations, whole=True, bare=True)
    out["access: from memory"] = Manner(in_memory=True)
    out["access: tile by tile, last first"] = Manner(tile_by_tile=True, seed=0)
    if absence() is None:
        out["compiled kernel: off"] = Manner(bare=True)
        out["compiled kernel: off, 4 threads"] = Manner(bare=True, threads=4)
    return out


def orders(count: int = ORDERS) -> dict[str, Manner]:
    """Random orders of tiles, rows and sums, in 1, 2 and 4 threads and with and without the kernel by turns."""
    return {
        f"order {seed}": Manner(
            make=partial(PermutedOperations, seed), threads=(1, 2, 4)[seed % 3], seed=seed, bare=seed % 2 == 1
        )
        for seed in range(1, count + 1)
    }


def vectors() -> list[Path]:
    """The files of the conformance suite that decode."""
    return sorted(path for kind in ("valid", "edge") for path in VECTORS.glob(f"{kind}/*/input.scar"))


def neural_vectors() -> list[Path]:
    """The files with integer networks, or of many tiles and layers: where an order could show."""
    wanted = ("anchors-neural", "index-", "predictors", "grid-", "activation-", "sixteen-layers", "tiles-", "one-cell")
    return [path for path in vectors() if path.parent.name.startswith(wanted)]

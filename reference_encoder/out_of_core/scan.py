"""The first passes over a scene in chunks: whether it can be encoded, its bounds, and how many Gaussians lie where.

Where: in the cells of the octree at one depth, by Morton code, only those that hold some. Counts add up, so that many
chunks are counted side by side.
"""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from reference_encoder.out_of_core.source import Chunk, Part, read, read_positions
from reference_encoder.out_of_core.types import Bounds, Range
from reference_encoder.out_of_core.work_dir import WorkDir
from reference_encoder.rdo.lattice import cut_cubes
from scarfmt.arrays import I64, U64
from scarfmt.errors import InvalidInput
from scarfmt.formats.clean import Counts, Faults, keep_edges, nothing_left, warn_dropped, warn_of
from scarfmt.limits import MAX_TILE_DEPTH
from scarfmt.scene.gaussians import GaussianScene, concatenate

DEPTH = 10
"""Depth of the cells that are counted first; cells that hold too many are counted at `DEEPER` more, again and again."""
DEEPER = 5


@dataclass(frozen=True)
class Scanned:
    """Result of scanning a chunk.

    Attributes:
        count: Gaussians.
        unusable: how many of them cannot be encoded.
        first, absurd, visible: as :class:`scarfmt.formats.clean.Faults` has them.
        edges: what :func:`scarfmt.formats.clean.keep_edges` counted.
        low, high: of the positions of those that can be encoded, world units; infinite where there are none.
        sh_degree: of their colours.
    """

    count: int
    unusable: int
    first: str | None
    absurd: tuple[str, str, float] | None
    visible: int
    edges: Counts
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    sh_degree: int


@dataclass(frozen=True)
class Cells:
    """Numbers of Gaussians in cells of the octree that do not overlap.

    Attributes:
        first: (n,) uint64 Morton code at `MAX_TILE_DEPTH` at which each cell begins, ascending.
        depth: (n,) int64 depth of each.
        count: (n,) int64 Gaussians in each, at least 1.
    """

    first: U64
    depth: I64
    count: I64


def scan_chunk(chunk: Chunk) -> Scanned:
    """Bounds of a chunk, and what of it cannot be encoded.

    Raises:
        InvalidInput, Unsupported, LimitExceeded: as the reader of its format says.
    """
    return _join([_scan_part(part) for part in chunk.parts])


def _scan_part(part: Part) -> Scanned:
    scene, numbers = read(part)
    scene, edges = keep_edges(scene)
    faults = Faults.of(scene, numbers, part.name)
    usable = scene.positions[~faults.rows]
    low, high = (np.full(3, np.inf), np.full(3, -np.inf)) if not len(usable) else (usable.min(0), usable.max(0))
    unusable = int(np.count_nonzero(faults.rows))
    found = faults.first, faults.absurd, faults.visible, edges
    return Scanned(len(scene), unusable, *found, _three(low), _three(high), scene.sh_degree)


def _three(values: Iterable[float]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _join(scans: Sequence[Scanned]) -> Scanned:
    return Scanned(
        sum(scan.count for scan in scans),
        sum(scan.unusable for scan in scans),
        next((scan.first for scan in scans if scan.first is not None), None),
        next((scan.absurd for scan in scans if scan.absurd is not None), None),
        sum(scan.visible for scan in scans),
        dict(sum((Counter(scan.edges) for scan in scans), Counter())),
        _three(np.min([scan.low for scan in scans], axis=0)),
        _three(np.max([scan.high for scan in scans], axis=0)),
        max(scan.sh_degree for scan in scans),
    )


def bounds_of(scans: Sequence[Scanned], drop_invalid: bool, sh_degree: int | None) -> Bounds:
    """Bounds of all chunks together.

    Args:
        scans: of all chunks, in order.
        drop_invalid: whether Gaussians that cannot be encoded are left out.
        sh_degree: bands above are dropped; None for none.

    Raises:
        InvalidInput: ``input-empty``, ``input-not-finite``, ``input-range``: as a reader of everything says, but for
            the file, which is named.

    Warns:
        InputWarning: as a reader of everything does.
    """
    if not any(scan.count for scan in scans):
        raise InvalidInput("input-empty", "the scene holds no Gaussians; there is nothing to encode")
    whole = _join(scans)
    if whole.unusable and not drop_invalid:
        Faults.refusal(whole.unusable, whole.count, whole.first, whole.absurd, whole.visible)
    if whole.unusable == whole.count:
        raise nothing_left(whole.unusable)
    warn_of(whole.edges, whole.count)
    if whole.unusable:
        warn_dropped(whole.unusable, whole.count, whole.visible)
    degree = whole.sh_degree if sh_degree is None else min(sh_degree, whole.sh_degree)
    return Bounds(whole.low, whole.high, whole.count - whole.unusable, degree)


def read_usable(chunk: Chunk, clean: bool) -> GaussianScene:
    """The Gaussians of a chunk that can be encoded, in order.

    Args:
        clean: whether it is known that all can.
    """
    scenes = []
    for part in chunk.parts:
        scene, numbers = read(part)
        scene, _ = keep_edges(scene)
        if clean:
            scenes.append(scene)
            continue
        rows = Faults.of(scene, numbers).rows
        scenes.append(scene.take(~rows) if rows.any() else scene)
    return concatenate(scenes)


def count_chunk(
    work: WorkDir, name: str, chunk: Chunk, bounds: Bounds, clean: bool, depth: int, crowded: U64 | None = None
) -> int:
    """Count the Gaussians of a chunk in cells of a depth, and keep the counts.

    Args:
        clean: whether it is known that all of its Gaussians can be encoded.
        crowded: Morton codes of cells `DEEPER` less deep, ascending: only what lies in these is counted; None for all.

    Returns:
        Cells that hold some.
    """
    parts = [read_positions(part) for part in chunk.parts] if clean else [read_usable(chunk, clean).positions]
    codes = bounds.paths(np.concatenate(parts)) >> np.uint64(3 * (MAX_TILE_DEPTH - depth))
    if crowded is not None:
        above = codes >> np.uint64(3 * DEEPER)
        at = np.minimum(np.searchsorted(crowded, above), len(crowded) - 1)
        codes = codes[crowded[at] == above]
    cells, counts = np.unique(codes, return_counts=True)
    with work.write(name) as stream:
        np.save(stream, np.stack([cells, counts.astype(np.uint64)]))
    return len(cells)


def counts_in(work: WorkDir, names: Sequence[str]) -> tuple[U64, I64]:
    """Codes, ascending, and counts of all cells of some files of counts together; halves of them are added first."""
    if len(names) == 1:
        cells, counts = np.load(io.BytesIO(work.read(names[0])))
        return cells, counts.astype(np.int64)
    half = len(names) // 2
    parts = counts_in(work, names[:half]), counts_in(work, names[half:])
    codes, counts = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    cells, at = np.unique(codes, return_inverse=True)
    total = np.zeros(len(cells), np.int64)
    np.add.at(total, at, counts)
    return cells, total


def first_cells(codes: U64, counts: I64, depth: int) -> Cells:
    """Cells of one depth from their codes at it."""
    shift = np.uint64(3 * (MAX_TILE_DEPTH - depth))
    return Cells(codes << shift, np.full(len(codes), depth, np.int64), counts)


def find_crowded(cells: Cells, most: int) -> U64:
    """Codes at their depth, ascending, of cells that hold more than `most` and can be divided: all are the deepest."""
    deepest = int(cells.depth.max())
    if deepest + DEEPER > MAX_TILE_DEPTH:
        return np.empty(0, np.uint64)
    codes: U64 = cells.first[cells.count > most] >> np.uint64(3 * (MAX_TILE_DEPTH - deepest))
    return codes


def divide(cells: Cells, codes: U64, counts: I64) -> Cells:
    """`cells` with the deepest that were counted again replaced by what they hold, `DEEPER` deeper."""
    depth = int(cells.depth.max()) + DEEPER
    deeper = first_cells(codes, counts, depth)
    again = np.unique(codes >> np.uint64(3 * DEEPER)) << np.uint64(3 * (MAX_TILE_DEPTH - depth + DEEPER))
    chosen = ~np.isin(cells.first, again)
    first = np.concatenate([cells.first[chosen], deeper.first])
    order = np.argsort(first, kind="stable")
    depths = np.concatenate([cells.depth[chosen], deeper.depth])
    return Cells(first[order], depths[order], np.concatenate([cells.count[chosen], deeper.count])[order])


END = 1 << 3 * MAX_TILE_DEPTH
"""One past the last Morton code."""


def partition(cells: Cells, range_size: int, tile_anchors: int) -> tuple[Range, ...]:
    """Ranges that hold about equally many, at most about `range_size` Gaussians; together they are everything.

    Args:
        tile_anchors: most Gaussians of a tile.
    """
    # A cube may begin before the first of its cells that hold something.
    depth, prefix, begins = cut_cubes(cells.first, MAX_TILE_DEPTH, tile_anchors, cells=(cells.depth, cells.count))
    first = prefix << (3 * (MAX_TILE_DEPTH - depth)).astype(np.uint64)
    past = np.cumsum(np.add.reduceat(cells.count, begins))
    total = int(past[-1])
    wanted = -(-total // range_size)
    # The first cube that ends at or after each equal share of the scene is the last of a range.
    last = np.searchsorted(past, np.arange(1, wanted + 1) * total / wanted)
    last = np.unique(np.minimum(last, len(past) - 1))
    held = np.diff(past[last], prepend=0)
    starts = [0, *(int(first[cube + 1]) for cube in last[:-1])]
    return tuple(
        Range(number, begin, end, int(count))
        for number, (begin, end, count) in enumerate(zip(starts, [*starts[1:], END], held, strict=True))
    )

"""The shuffle: from chunks in the order of the source to ranges of space, with one file a chunk.

A file holds the rows of its chunk grouped by range, each group in the order of the source. One index tells where the
group of each range is in each file, so that a range is read with one request a file. A range's Gaussians come in the
order of the source, whatever was read by whom and when.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from reference_encoder.scale.scan import usable
from reference_encoder.scale.source import Chunk
from reference_encoder.scale.steps import Bounds, Range
from reference_encoder.scale.work import Work
from scarfmt.arrays import I64
from scarfmt.formats.joined import widened
from scarfmt.scene.gaussians import GaussianScene

INDEX = "bins/index"
_PIECE_ROWS = 1 << 16


def row_type(sh_degree: int) -> np.dtype[np.void]:
    """The type of a row in a file of a chunk: what :class:`GaussianScene` has of a Gaussian."""
    attributes = [("positions", "<f8", 3), ("log_scales", "<f4", 3), ("rotations", "<f4", 4)]
    return np.dtype([*attributes, ("opacity_logits", "<f4"), ("sh", "<f4", ((sh_degree + 1) ** 2, 3))])


def _name(chunk: int) -> str:
    return f"bins/{chunk:06}"


def bin_chunk(work: Work, chunk: Chunk, bounds: Bounds, clean: bool, ranges: Sequence[Range]) -> I64:
    """Write the file of a chunk.

    Args:
        work: where it is written.
        chunk: what to read.
        bounds, ranges: of the scene.
        clean: whether it is known that all Gaussians can be encoded; others are left out.

    Returns:
        (ranges + 1,) int64: first row of each range in it, and the number of rows.
    """
    scene = usable(chunk, clean)
    coefficients = (bounds.sh_degree + 1) ** 2
    borders = np.array([one.first for one in ranges[1:]], np.uint64)
    owner = np.searchsorted(borders, bounds.paths(scene.positions), side="right")
    order = np.argsort(owner, kind="stable")
    with work.write(_name(chunk.number)) as stream:
        for start in range(0, len(order), _PIECE_ROWS):
            part = scene.take(order[start : start + _PIECE_ROWS])
            rows = np.empty(len(part), row_type(bounds.sh_degree))
            for name in ("positions", "log_scales", "rotations", "opacity_logits"):
                rows[name] = getattr(part, name)
            rows["sh"] = widened(part.sh[:, :coefficients], coefficients)
            stream.write(rows.tobytes())
    edges = np.arange(len(ranges) + 1)
    return np.searchsorted(owner[order], edges).astype(np.int64)


def write_index(work: Work, edges: Sequence[I64]) -> None:
    """Keep where the rows of every range are.

    Args:
        work: where the files of the chunks are.
        edges: of each chunk, what :func:`bin_chunk` gave.
    """
    table = np.stack(edges)
    with work.write(INDEX) as stream:
        stream.write(np.stack([table[:, :-1].T, table[:, 1:].T], axis=1).astype("<i8").tobytes())


def load_range(work: Work, chunks: int, bounds: Bounds, number: int) -> GaussianScene:
    """The Gaussians of a range, in the order of the source.

    Args:
        work: with the files of `chunks` chunks, and their index.
        chunks: how many there are.
        bounds: of the scene.
        number: of the range.
    """
    kind = row_type(bounds.sh_degree)
    [row] = work.read_ranges(INDEX, [(number * chunks * 16, chunks * 16)])
    begin, end = np.frombuffer(row, "<i8").reshape(2, chunks)
    rows = np.empty(int((end - begin).sum()), kind)
    filled = 0
    for chunk in np.flatnonzero(end > begin).tolist():
        first, count = int(begin[chunk]), int(end[chunk] - begin[chunk])
        [data] = work.read_ranges(_name(chunk), [(first * kind.itemsize, count * kind.itemsize)])
        rows[filled : filled + count] = np.frombuffer(data, kind)
        filled += count
    return GaussianScene(*(np.ascontiguousarray(rows[name]) for name in kind.names or ()))

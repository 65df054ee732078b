"""The shuffle: from chunks in the order of the source to ranges of space, with one file a chunk.

A file holds the rows of its chunk grouped by range, each group in the order of the source and attribute by attribute,
as arrays of Gaussians are held in memory. One index tells where the group of each range is in each file, so that a
range is read with one request a file. A range's Gaussians come in the order of the source, whatever was read by whom
and when.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reference_encoder.out_of_core.scan import read_usable
from reference_encoder.out_of_core.source import Chunk
from reference_encoder.out_of_core.types import Bounds, Range
from reference_encoder.out_of_core.work_dir import WorkDir, file_name
from scarfmt.arrays import I64
from scarfmt.scene.gaussians import GaussianScene, pad_harmonics

INDEX = "bins/index"


def _attributes(sh_degree: int) -> Mapping[str, tuple[type, tuple[int, ...]]]:
    """Type and shape of each attribute of one Gaussian, in the order in which a group has them."""
    return {
        "positions": (np.float64, (3,)),
        "log_scales": (np.float32, (3,)),
        "rotations": (np.float32, (4,)),
        "opacity_logits": (np.float32, ()),
        "sh": (np.float32, ((sh_degree + 1) ** 2, 3)),
    }


def bin_chunk(work: WorkDir, chunk: Chunk, bounds: Bounds, clean: bool, ranges: Sequence[Range]) -> I64:
    """Write the file of a chunk.

    Args:
        clean: whether it is known that all Gaussians can be encoded; others are left out.

    Returns:
        (ranges + 1,) int64: first row of each range in it, and the number of rows.
    """
    scene = read_usable(chunk, clean)
    coefficients = (bounds.sh_degree + 1) ** 2
    borders = np.array([one.first for one in ranges[1:]], np.uint64)
    owner = np.searchsorted(borders, bounds.paths(scene.positions), side="right")
    order = np.argsort(owner, kind="stable")
    edges = np.searchsorted(owner[order], np.arange(len(ranges) + 1)).astype(np.int64)
    with work.write(file_name("bins", chunk.number)) as stream:
        for begin, end in itertools.pairwise(edges.tolist()):
            part = scene.take(order[begin:end])
            part = replace(part, sh=pad_harmonics(part.sh[:, :coefficients], coefficients))
            for name, (kind, _) in _attributes(bounds.sh_degree).items():
                stream.write(np.ascontiguousarray(getattr(part, name), kind).tobytes())
    return edges


def write_index(work: WorkDir, edges: Sequence[I64]) -> None:
    """Keep where the rows of every range are: of each chunk, what :func:`bin_chunk` gave."""
    table = np.stack(edges)
    with work.write(INDEX) as stream:
        stream.write(np.stack([table[:, :-1].T, table[:, 1:].T], axis=1).astype("<i8").tobytes())


def load_range(work: WorkDir, chunks: int, bounds: Bounds, number: int) -> GaussianScene:
    """The Gaussians of a range, by its number, in the order of the source, from the files of so many `chunks`."""
    [row] = work.read_ranges(INDEX, [(number * chunks * 16, chunks * 16)])
    begin, end = np.frombuffer(row, "<i8").reshape(2, chunks)
    attributes = _attributes(bounds.sh_degree)
    total = int((end - begin).sum())
    each = sum(np.dtype(kind).itemsize * math.prod(shape) for kind, shape in attributes.values())
    found: dict[str, NDArray[Any]]
    found = {name: np.empty((total, *shape), kind) for name, (kind, shape) in attributes.items()}
    filled = 0
    for chunk in np.flatnonzero(end > begin).tolist():
        first, count = int(begin[chunk]), int(end[chunk] - begin[chunk])
        [data] = work.read_ranges(file_name("bins", chunk), [(first * each, count * each)])
        offset = 0
        for name, (kind, shape) in attributes.items():
            rows: NDArray[Any] = np.frombuffer(data, kind, count * math.prod(shape), offset)
            found[name][filled : filled + count] = rows.reshape(count, *shape)
            offset += rows.nbytes
        filled += count
    return GaussianScene(**found, description=bounds.description)

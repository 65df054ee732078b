"""Exact k-means of many points with many centroids on a processor, for an encoder that expects a GPU.

    python -m benchmarks.rivals_kmeans FOLDER COLUMNS ITERATIONS

FOLDER holds points.f32 and centroids.f32, rows of COLUMNS little-endian float32. The centroids are replaced, and
labels.u32 is written: as @playcanvas/splat-transform would without a GPU, only in minutes instead of hours.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from scarfmt.arrays import F32

# A tile of products should stay in the second-level cache.
_POINTS, _CENTROIDS = 256, 1024
_SEED = 1


def kmeans(points: F32, centroids: F32, iterations: int) -> tuple[F32, NDArray[np.uint32]]:
    """Lloyd's iterations.

    Args:
        points: (N, D) float32.
        centroids: (K, D) float32, the first guess.
        iterations: of assigning points and moving centroids.

    Returns:
        The (K, D) centroids after the last move, and (N,) labels: those of the assignment before it. A centroid
        without points has moved to a point taken at random.
    """
    random = np.random.default_rng(_SEED)
    labels = np.zeros(len(points), np.uint32)
    for _ in range(iterations):
        labels = nearest(points, centroids)
        counts = np.bincount(labels, minlength=len(centroids))
        sums = np.stack([np.bincount(labels, column, len(centroids)) for column in points.T], axis=1)
        moved = sums / np.maximum(counts, 1)[:, None]
        empty = counts == 0
        moved[empty] = points[random.integers(len(points), size=int(empty.sum()))]
        centroids = moved.astype(np.float32)
    return centroids, labels


def nearest(points: F32, centroids: F32) -> NDArray[np.uint32]:
    """(N,) index of the centroid nearest to each point: the largest of p·c - |c|²/2."""
    extended = torch.from_numpy(np.pad(points, ((0, 0), (0, 1)), constant_values=1))
    offsets = -(centroids.astype(np.float64) ** 2).sum(axis=1) / 2
    table = torch.from_numpy(np.concatenate([centroids, offsets[:, None].astype(np.float32)], axis=1).T.copy())
    parts = range(0, len(extended), _POINTS)
    found = [_nearest_of(extended[start : start + _POINTS], table) for start in parts]
    return torch.cat(found).numpy().astype(np.uint32)


def _nearest_of(rows: torch.Tensor, table: torch.Tensor) -> torch.Tensor:
    best = torch.full((len(rows),), -torch.inf)
    index = torch.zeros(len(rows), dtype=torch.int64)
    for start in range(0, table.shape[1], _CENTROIDS):
        value, where = torch.mm(rows, table[:, start : start + _CENTROIDS]).max(dim=1)
        better = value > best
        best = torch.where(better, value, best)
        index = torch.where(better, where + start, index)
    return index


def main() -> None:
    folder, columns, iterations = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    points, centroids = (
        np.fromfile(folder / name, "<f4").reshape(-1, columns) for name in ("points.f32", "centroids.f32")
    )
    centroids, labels = kmeans(points, centroids, iterations)
    centroids.astype("<f4").tofile(folder / "centroids.f32")
    labels.astype("<u4").tofile(folder / "labels.u32")


if __name__ == "__main__":
    main()

"""Small scenes for tests of the out-of-core encoder, and files of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from reference_encoder.out_of_core.bins import bin_chunk, write_index
from reference_encoder.out_of_core.scan import bounds_of, count_chunk, counts_in, first_cells, partition, scan_chunk
from reference_encoder.out_of_core.source import find_inputs
from reference_encoder.out_of_core.types import Bounds, Range
from reference_encoder.out_of_core.work_dir import WorkDir
from scarfmt.scene.gaussians import GaussianScene
from tests.formats.scene_files import scene_ply


def clusters(count: int, seed: int = 0, degree: int = 1) -> GaussianScene:
    """Gaussians in three clouds of different sizes, one of them far away."""
    rng = np.random.default_rng(seed)
    centres = np.array([[0, 0, 0], [3, 1, 0], [-40, 8, 5]])[rng.choice(3, count, p=[0.6, 0.35, 0.05])]
    positions = centres + rng.normal(size=(count, 3)) * [1.0, 0.3, 1.0]
    return GaussianScene(
        positions.astype(np.float32).astype(np.float64),
        rng.normal(-2.5, 0.5, (count, 3)).astype(np.float32),
        rng.normal(size=(count, 4)).astype(np.float32),
        rng.normal(1.0, 2.0, count).astype(np.float32),
        rng.normal(0.0, 0.5, (count, (degree + 1) ** 2, 3)).astype(np.float32),
    )


def ply_of(scene: GaussianScene, folder: Path, name: str = "scene.ply") -> str:
    path = folder / name
    path.write_bytes(scene_ply(scene))
    return str(path)


def equal(a: GaussianScene, b: GaussianScene) -> bool:
    """Whether two scenes are the same numbers in the same order, zeros above the lower degree apart."""
    least = min(a.sh.shape[1], b.sh.shape[1])
    rest = not a.sh[:, least:].any() and not b.sh[:, least:].any()
    names = ("positions", "log_scales", "rotations", "opacity_logits")
    same = all(np.array_equal(getattr(a, name), getattr(b, name)) for name in names)
    return same and rest and np.array_equal(a.sh[:, :least], b.sh[:, :least])


def binned(
    origin: str, work: WorkDir, *, rows: int, range_size: int, tile: int, drop: bool = False, degree: int | None = None
) -> tuple[Bounds, tuple[Range, ...], int]:
    """Scan, cut and bin, one task after another; bounds, ranges, and the number of chunks."""
    chunks = find_inputs(origin, rows).chunks
    bounds = bounds_of([scan_chunk(chunk) for chunk in chunks], drop, degree)
    names = [f"counts/{chunk.number}" for chunk in chunks]
    for name, chunk in zip(names, chunks, strict=True):
        count_chunk(work, name, chunk, bounds, not drop, 6)
    ranges = partition(first_cells(*counts_in(work, names), 6), range_size, tile)
    write_index(work, [bin_chunk(work, chunk, bounds, not drop, ranges) for chunk in chunks])
    return bounds, ranges, len(chunks)

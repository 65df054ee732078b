"""The rivals of streaming: whole SOG, whole SPZ, and SOG in levels of detail ("streamed SOG").

All are written by splat-transform (`benchmarks.rivals_tools`) and kept beside the other rivals' files. Spherical
harmonics of SOG take 3 iterations of k-means in place of 10: without a GPU ten take an hour, and bytes stay the same.

Streamed SOG has two levels here: all Gaussians, and an eighth of them, made by the same program. Its viewer shows the
coarsest level first and then goes for the finest, so that levels between them would not be loaded. Each level is one
SOG, as splat-transform leaves scenes of up to half a million Gaussians by default. Smaller chunks would have a palette
each: plush-on-bed in chunks of 32,768 is 42 bytes a Gaussian in place of 24.
"""

from __future__ import annotations

import gzip
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from zipfile import ZipFile

from benchmarks.rivals_formats import Format, read, spz_scale
from benchmarks.rivals_run import kept_file, source_ply, written
from benchmarks.rivals_tools import Command, measured, splat_transform
from benchmarks.scenes import Scene
from scarfmt.scene.gaussians import GaussianScene

ITERATIONS = ("--sh-iterations", "3")
COARSE = "12.5%"
"""Gaussians of the coarser level."""
INDEX_BYTES = 313
"""Bytes of a lod-meta.json with one place and two levels, gzipped."""
GOOD_BITS = (6, 5)
_STEPS = 32


@dataclass(frozen=True)
class Whole:
    """A file that shows nothing before its end.

    Attributes:
        name: as tables show it.
        size: bytes.
        scene: what it shows.
    """

    name: str
    size: int
    scene: GaussianScene


@dataclass(frozen=True)
class Levels:
    """A scene of streamed SOG.

    Attributes:
        index_size: bytes of lod-meta.json as servers send it, gzipped.
        files: of each level, the coarsest first: bytes of its meta.json, gzipped, and of the pictures that it names.
        scenes: of each level, what it shows.
    """

    index_size: int
    files: list[tuple[int, tuple[int, ...]]]
    scenes: list[GaussianScene]

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return self.index_size + sum(first + sum(others) for first, others in self.files)


def wholes(scene: Scene, gaussians: GaussianScene) -> list[Whole]:
    """SOG, SPZ at its defaults, and SPZ that is as good as SOG."""
    source = source_ply(scene, gaussians)
    found = []
    for rival in _formats(gaussians):
        path, _ = written(scene, source, rival, False)
        found.append(Whole(f"whole {rival.name}", path.stat().st_size, read(path, rival.scale)))
    return found


_SOG = Format("SOG", "sog", ".sog", lambda source, out: splat_transform(*ITERATIONS, str(source), str(out)))


def _formats(gaussians: GaussianScene) -> Iterator[Format]:
    yield _SOG
    yield Format("SPZ", "spz", ".spz", lambda source, out: splat_transform(str(source), str(out)))
    scale, (first, others) = spz_scale(gaussians, _STEPS), GOOD_BITS
    more = {"SPZ_SH1_BITS": str(first), "SPZ_SH_REST_BITS": str(others)}

    def fitted(source: Path, out: Path) -> Command:
        return splat_transform(str(source), "--scale", repr(scale), str(out), **more)

    yield Format("SPZ, fitted", "spz", ".spz", fitted, scale)


def levels(scene: Scene, gaussians: GaussianScene) -> Levels:
    """Streamed SOG of a scene."""
    source = source_ply(scene, gaussians)
    fine, _ = written(scene, source, _SOG, False)
    coarse = kept_file(scene, source, _SOG).with_suffix(".eighth.sog")
    if not coarse.exists():
        print(f"{scene.name}: an eighth of its Gaussians", file=sys.stderr, flush=True)
        fewer = coarse.with_suffix(".ply")
        measured(splat_transform(str(source), "--decimate", COARSE, str(fewer)))
        measured(splat_transform(*ITERATIONS, str(fewer), str(coarse)))
        fewer.unlink()
    paths = coarse, fine
    return Levels(INDEX_BYTES, [sizes(path) for path in paths], [read(path) for path in paths])


def sizes(path: Path) -> tuple[int, tuple[int, ...]]:
    """Bytes of the members of a SOG as files of their own: meta.json, gzipped, and the pictures."""
    with ZipFile(path) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    meta = members.pop("meta.json")
    return len(gzip.compress(meta, 9, mtime=0)), tuple(map(len, members.values()))

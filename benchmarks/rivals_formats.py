"""The rival file formats: each at each setting, how it is written and how it is read.

A file is read by the faster of two readers: this repository's importers, and gsply, which a user of Python would
install. gsply is not needed: where it is missing only the importers are timed.
"""

from __future__ import annotations

import importlib
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import child
from benchmarks.rivals_tools import PYTHON, Command, splat_transform
from scarfmt.formats import load
from scarfmt.formats.frame import RUB_TO_RDF, flip_axes
from scarfmt.scene.gaussians import GaussianScene

# SPZ: the farthest a coordinate can lie, and the largest log scale.
_SPZ_REACH, _SPZ_LARGEST = 2047.0, 255 / 16 - 10
# Positions of SPZ are multiples of 2^-12. The scene is enlarged so that so many of them make up the thickness of the
# median Gaussian: one choice for small files, one for good ones.
_SPZ_STEP, _STEPS_A_GAUSSIAN = 2.0**-12, (4, 32)
_SPZ_DEFAULT_BITS = (5, 4)
# Bits of the first band and of the others: at the scene's own size, and enlarged. More depths where sizes fit better.
_SPZ_BITS = ((6, 5), (7, 6), (8, 8))
_SPZ_FITTED_BITS = (_SPZ_DEFAULT_BITS, (6, 5), (7, 6), (7, 7), (8, 8))
_SPZ_FEW_BITS = ((8, 8),)


@dataclass(frozen=True)
class Format:
    """A format at one setting.

    Attributes:
        name: as tables show it.
        family: ``spz``, ``sog`` or ``compressed-ply``.
        suffix: of its files.
        command: how to write it, of the source as INRIA's PLY and of the path to write.
        scale: the scene is enlarged by this much before it is written; a power of two.
    """

    name: str
    family: str
    suffix: str
    command: Callable[[Path, Path], Command]
    scale: float = 1.0


def list_formats(scene: GaussianScene, few: bool = False) -> list[Format]:
    """Everything that is measured on `scene`; with `few`, SPZ at its defaults and its finest only."""
    def plain(source: Path, out: Path) -> Command:
        return splat_transform(str(source), str(out))

    ply = Format("compressed.ply", "compressed-ply", ".compressed.ply", plain)
    return [*_spz(scene, few), Format("SOG", "sog", ".sog", plain), ply]


def _spz(scene: GaussianScene, few: bool) -> list[Format]:
    found = [
        Format("SPZ v3", "spz", ".spz", _spz_command(3, 1.0, _SPZ_DEFAULT_BITS)),
        Format("SPZ v4", "spz", ".spz", _spz_command(4, 1.0, _SPZ_DEFAULT_BITS)),
    ]
    depths: dict[float, tuple[tuple[int, int], ...]] = {1.0: _SPZ_FEW_BITS if few else _SPZ_BITS}
    if not few:
        depths.update({spz_scale(scene, steps): _SPZ_FITTED_BITS for steps in _STEPS_A_GAUSSIAN})
    for scale, pairs in depths.items():
        for bits in pairs if scene.sh_degree else (_SPZ_DEFAULT_BITS,):
            if (scale, bits) == (1.0, _SPZ_DEFAULT_BITS):
                continue
            words = ["SPZ v4"]
            words += [f"times {scale:g}"] if scale != 1 else []
            words += [f"SH {bits[0]}+{bits[1]} bit"] if scene.sh_degree else []
            found.append(Format(", ".join(words), "spz", ".spz", _spz_command(4, scale, bits), scale))
    return found


def spz_scale(scene: GaussianScene, steps: int) -> float:
    """The enlargement, a power of two, that makes `steps` of SPZ's steps of position as large as a Gaussian is thick.

    Never so large that a coordinate or a scale leaves the range SPZ has for it.
    """
    log_scales = scene.log_scales.astype(np.float64)
    thickness = math.exp(float(np.median(log_scales.min(axis=1))))
    wanted = _SPZ_STEP * steps / thickness
    reach = _SPZ_REACH / max(float(np.abs(scene.positions).max()), 1e-30)
    room = math.exp(_SPZ_LARGEST - float(log_scales.max()))
    return 2.0 ** math.floor(math.log2(min(wanted, reach, room)))


def _spz_command(version: int, scale: float, bits: tuple[int, int]) -> Callable[[Path, Path], Command]:
    def command(source: Path, out: Path) -> Command:
        enlarge = [] if scale == 1 else ["--scale", repr(scale)]
        words = [str(source), *enlarge, "--spz-version", str(version), str(out)]
        return splat_transform(*words, SPZ_SH1_BITS=str(bits[0]), SPZ_SH_REST_BITS=str(bits[1]))

    return command


def read(path: Path, scale: float = 1.0) -> GaussianScene:
    """A rival's file as the scene it stands for, in the axes of its source.

    Args:
        scale: what the scene was enlarged by before it was written.
    """
    scene = load(path)
    assert isinstance(scene, GaussianScene)
    if path.suffix == ".spz":  # its writer leaves the axes as they are
        scene = flip_axes(scene, RUB_TO_RDF)
    if scale == 1:
        return scene
    log_scales = (scene.log_scales - np.float32(math.log(scale))).astype(np.float32)
    return replace(scene, positions=scene.positions / scale, log_scales=log_scales)


# Readers

OURS, GSPLY = "importer of this repository", "gsply"
_GSPLY_READS = {".spz": "read_spz", ".sog": "sogread", ".ply": "plyread"}


def measure_reading(path: Path, scale: float) -> dict[str, Any]:
    """The faster of the readers that are here: ``seconds`` (the least of some runs), ``peak_bytes`` and ``reader``."""
    readers = [OURS, *([GSPLY] if path.suffix in _GSPLY_READS and (PYTHON / "gsply").exists() else [])]
    job = {"job": "benchmarks.rivals_formats:read_job", "file": str(path), "scale": scale}
    found = [{**child.run(child.ENVIRONMENT, **job, reader=reader), "reader": reader} for reader in readers]
    best = min(found, key=lambda report: float(report["seconds"]))
    return {key: best[key] for key in ("seconds", "peak_bytes", "reader")}


def read_job(job: dict[str, Any]) -> dict[str, Any]:
    """Job of `benchmarks.child`: time one reader; what it compiles at first use is not counted."""
    path = Path(job["file"])
    if job["reader"] == OURS:
        return child.time_calls(lambda: read(path, job["scale"]))
    sys.path.insert(0, str(PYTHON))
    gsply: Any = importlib.import_module("gsply")
    gsply.use_backend("auto")
    act = getattr(gsply, _GSPLY_READS[path.suffix])
    return child.time_calls(lambda: act(str(path)))

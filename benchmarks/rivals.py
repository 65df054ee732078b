"""What other formats need on the same scenes from the same eight views, for the tables of `benchmarks.quality`.

`benchmarks.rivals_run` measures them; scenes it has no results of yet have figures that were measured once, before
this project began. SOG: @playcanvas/splat-transform 3.7.0, the smaller of its two settings. SPZ: Niantic's version 4;
*tuned* is scaled so that positions and scales use its fixed ranges well; N bit is the depth of its spherical harmonics.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from benchmarks.report import load_results


class Rival(NamedTuple):
    """One measured file: format, bytes per Gaussian, mean PSNR in dB."""

    name: str
    bytes_per_gaussian: float
    psnr_db: float


_LEAST_DB = 36.0
_EARLIER = {
    "plush-on-bed": (
        Rival("SPZ, default", 23.46, 37.21),
        Rival("SOG", 24.21, 43.63),
        Rival("SPZ, tuned, 7 bit", 33.83, 46.06),
        Rival("SPZ, 8 bit", 42.27, 54.72),
    ),
    "flowers": (
        Rival("SOG", 17.50, 41.44),
        Rival("SPZ, tuned", 21.97, 43.27),
        Rival("SPZ, tuned, 6 bit", 23.19, 47.42),
        Rival("SPZ, tuned, 7 bit", 24.55, 49.53),
        Rival("SPZ, tuned, 8 bit", 26.21, 51.70),
    ),
    "plush-dog": (
        Rival("SPZ, default", 24.92, 37.72),
        Rival("SPZ, tuned, 6 bit", 32.62, 43.49),
        Rival("SPZ, tuned, 7 bit", 38.04, 47.73),
        Rival("SPZ, tuned, 8 bit", 47.00, 53.76),
    ),
}


def best_rivals(run: Mapping[str, Any]) -> tuple[Rival, ...]:
    """From 36 dB, the files of a scene that no other file beats in both size and PSNR; the smallest first."""
    found: list[Rival] = []
    for rival in sorted(run["rivals"], key=lambda rival: (int(rival["bytes"]), -float(rival["psnr_db"]))):
        least = found[-1].psnr_db if found else _LEAST_DB
        if rival["psnr_db"] > least:
            found.append(Rival(rival["name"], rival["bytes"] / run["count"], rival["psnr_db"]))
    return tuple(found)


def _all() -> dict[str, tuple[Rival, ...]]:
    measured = {name: best_rivals(run) for name, run in load_results("rivals").items()}
    return {**_EARLIER, **{name: rivals for name, rivals in measured.items() if rivals}}


RIVALS = _all()
"""By scene."""
